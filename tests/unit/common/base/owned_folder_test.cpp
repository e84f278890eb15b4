#include "common/base/file.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace ledgerline {
namespace {

namespace fs = std::filesystem;

class OwnedFolderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(folder);
    for (const fs::path& path : {folder.parent_path(), folder}) ::chmod(path.c_str(), 0755);
    std::ofstream(folder / "states") << "text";
    ::chmod((folder / "states").c_str(), 0644);
  }
  ~OwnedFolderTest() override { fs::remove_all(folder.parent_path()); }

  /// What is read, or why not.
  std::string read(std::int64_t max_bytes = 100) const {
    const auto opened = OwnedFolder::open(folder);
    if (!opened) return opened.error().message;
    const auto text = opened->read("states", max_bytes);
    return text ? *text : text.error().message;
  }
  bool says(const std::string& word) const { return read().find(word) != std::string::npos; }

  const fs::path folder = fs::path(::testing::TempDir()) / ("owned_folder_" + std::to_string(::getpid())) / "snapshot";
};

TEST_F(OwnedFolderTest, ReadsWhatIsItsUsersAlone) {
  EXPECT_EQ(read(), "text");
  EXPECT_NE(read(3).find("at most 3"), std::string::npos);
}

TEST_F(OwnedFolderTest, RefusesWhatOthersMayWriteWhereverItIsOnTheWay) {
  for (const fs::path& path : {folder.parent_path(), folder, folder / "states"}) {
    for (const mode_t mode : {0775U, 0757U}) {
      ASSERT_EQ(::chmod(path.c_str(), mode), 0);
      EXPECT_TRUE(says("chmod go-w")) << path << ": " << read();
    }
    ::chmod(path.c_str(), 0755);
  }
  ::chmod(folder.parent_path().c_str(), 01777);  // as /tmp
  EXPECT_EQ(read(), "text");
}

TEST_F(OwnedFolderTest, RefusesWhatBelongsToSomebodyElseWhateverItsMode) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root gives files away";
  for (const fs::path& path : {folder.parent_path(), folder, folder / "states"}) {
    ASSERT_EQ(::chown(path.c_str(), 65534, 65534), 0);
    EXPECT_TRUE(says("neither this user nor root")) << path << ": " << read();
    ASSERT_EQ(::chown(path.c_str(), 0, 0), 0);
  }
  EXPECT_EQ(read(), "text");
}

TEST_F(OwnedFolderTest, FollowsNoLinkInTheFolderAndWaitsForNoPipe) {
  fs::rename(folder / "states", folder / "other");
  fs::create_symlink(folder / "other", folder / "states");
  EXPECT_NE(read(), "text");
  fs::remove(folder / "states");
  EXPECT_TRUE(says("no such file"));
  ASSERT_EQ(::mkfifo((folder / "states").c_str(), 0644), 0);
  EXPECT_TRUE(says("no such file"));
}

}  // namespace
}  // namespace ledgerline
