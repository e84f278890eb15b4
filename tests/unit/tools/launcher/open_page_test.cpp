#include "tools/launcher/machine.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "common/base/file.hpp"
#include "tests/fuzz/directory.hpp"

namespace ledgerline::launcher {
namespace {

using testing::HasSubstr;

/// PATH is a folder of its own as long as it lives.
class APage : public testing::Test {
 protected:
  APage() { ::setenv("PATH", directory.path.c_str(), 1); }
  ~APage() override { ::setenv("PATH", before_.c_str(), 1); }
  fuzz::Directory directory;

 private:
  std::string before_ = std::getenv("PATH");
};

TEST_F(APage, IsOpenedWithoutItsTokenOnACommandLine) {
  const std::string browser = directory.path + "/xdg-open", said = directory.path + "/said";
  std::ofstream(browser) << "#!/bin/sh\necho \"$*\" > " << said << ".new && /bin/mv " << said << ".new " << said
                         << "\n";
  ASSERT_EQ(::chmod(browser.c_str(), 0755), 0);
  const std::string file = directory.path + "/open.html", url = "http://127.0.0.1:1/#token=abc";
  const Status opened = open_in_browser(url, file);
  ASSERT_TRUE(opened) << opened.error().message;
  for (int i = 0; i < 1'000 && !read_file(said); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_EQ(*read_file(said), file + "\n");
  EXPECT_THAT(*read_file(file), HasSubstr("url=" + url));
  struct stat info {};
  ASSERT_EQ(::stat(file.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U) << "the token is in it";
}

TEST_F(APage, IsNotOpenedWhereNothingOpensIt) {
  EXPECT_THAT(open_in_browser("http://127.0.0.1:1", directory.path + "/open.html").error().message,
              HasSubstr("xdg-open"));
}

}  // namespace
}  // namespace ledgerline::launcher
