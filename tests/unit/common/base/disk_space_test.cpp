#include "common/base/file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace ledgerline {
namespace {

using testing::HasSubstr;

TEST(Space, AFileTakesWholeBlocksAndAMissingDirectoryNothing) {
  const std::string dir = testing::TempDir() + "ledgerline_space_" + std::to_string(::getpid());
  EXPECT_EQ(bytes_below(dir), 0U);
  std::filesystem::create_directories(dir + "/deep/er");
  const std::uint64_t before = bytes_below(dir);
  std::ofstream(dir + "/deep/er/file") << std::string(100'000, 'x');
  const std::uint64_t grown = bytes_below(dir) - before;
  EXPECT_GE(grown, 100'000U);
  EXPECT_LT(grown, 200'000U);
  std::filesystem::remove_all(dir);
}

TEST(Space, APlaceThatIsNotMadeYetHasTheRoomOfItsFolder) {
  const auto here = free_bytes("."), later = free_bytes("./not/yet/made");
  ASSERT_TRUE(here.ok() && later.ok());
  const double ratio = static_cast<double>(*later) / static_cast<double>(*here);  // others write meanwhile
  EXPECT_NEAR(ratio, 1, 0.1);
}

TEST(Space, TooLittleIsRefusedWithThePlaceAndBothFigures) {
  EXPECT_TRUE(enough_space("/somewhere", 100, 100, "a flight").ok());
  const Status status = enough_space("/somewhere", 99'000'000, 100'000'000, "a flight");
  ASSERT_FALSE(status.ok());
  for (const char* part : {"/somewhere", "99 MB free", "a flight needs 100 MB"}) {
    EXPECT_THAT(status.error().message, HasSubstr(part));
  }
}

}  // namespace
}  // namespace ledgerline
