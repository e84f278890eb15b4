#include "common/process/children.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>

namespace ledgerline {
namespace {

TEST(FindProgram, LooksInPathAndThenInTheOtherFolders) {
  EXPECT_TRUE(find_program("sh").ends_with("/sh"));
  const std::string folder = ::testing::TempDir() + "find_program_" + std::to_string(::getpid());
  ASSERT_EQ(::mkdir(folder.c_str(), 0700), 0);
  const std::string file = folder + "/ours_alone";
  std::ofstream(file) << "#!/bin/sh\n";
  EXPECT_EQ(find_program("ours_alone", "/nowhere:" + folder), "") << "it may not be run";
  ASSERT_EQ(::chmod(file.c_str(), 0700), 0);
  EXPECT_EQ(find_program("ours_alone"), "");
  EXPECT_EQ(find_program("ours_alone", "/nowhere:" + folder), file);
  ::unlink(file.c_str());
  ::rmdir(folder.c_str());
}

}  // namespace
}  // namespace ledgerline
