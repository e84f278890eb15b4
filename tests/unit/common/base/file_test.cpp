#include "common/base/file.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

namespace ledgerline {
namespace {

TEST(WriteFile, MakesTheWayThereAndWritesOver) {
  const std::string dir = ::testing::TempDir() + "/write_file_" + std::to_string(::getpid());
  const std::string path = dir + "/a/b/c";
  ASSERT_TRUE(write_file(path, "a longer text", 0644).ok());
  ASSERT_TRUE(write_file(path, "secret", 0600).ok());
  EXPECT_EQ(*read_file(path), "secret");
  struct stat info {};
  ASSERT_EQ(::stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);
  const auto below_a_file = write_file(path + "/d", "x");
  ASSERT_FALSE(below_a_file.ok());
  EXPECT_THAT(below_a_file.error().message, ::testing::HasSubstr("cannot write " + path + "/d: Not a directory"));
  std::filesystem::remove_all(dir);
}

TEST(WriteFile, LeavesTheModeOfWhatIsNoRegularFile) {
  const std::string path = ::testing::TempDir() + "/write_file_fifo_" + std::to_string(::getpid());
  ASSERT_EQ(::mkfifo(path.c_str(), 0666), 0);
  ASSERT_EQ(::chmod(path.c_str(), 0666), 0);
  const int reader = ::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  EXPECT_TRUE(write_file(path, "text", 0600).ok());
  struct stat info {};
  ASSERT_EQ(::stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0666U);
  ::close(reader);
  std::filesystem::remove(path);
}

TEST(ReplaceFile, IsWholeOrAsBeforeAndLeavesNothingBeside) {
  const std::string dir = ::testing::TempDir() + "/replace_file_" + std::to_string(::getpid());
  const std::string path = dir + "/a";
  ASSERT_TRUE(replace_file(path, "first", 0600).ok());
  ASSERT_TRUE(replace_file(path, "second", 0600).ok());
  EXPECT_EQ(*read_file(path), "second");
  struct stat info {};
  ASSERT_EQ(::stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);
  EXPECT_FALSE(std::filesystem::exists(path + ".new"));
  std::filesystem::create_directory(path + ".new");
  const auto blocked = replace_file(path, "third", 0600);
  ASSERT_FALSE(blocked.ok());
  EXPECT_THAT(blocked.error().message, ::testing::HasSubstr("cannot write " + path));
  EXPECT_EQ(*read_file(path), "second");
  std::filesystem::remove_all(dir);
}

TEST(PrivateFile, IsForItsOwnerOrRootsForAGroupOfOurs) {
  const std::vector<unsigned> ours{2000, 1000};
  for (const unsigned mode : {0600U, 0400U}) EXPECT_TRUE(is_private(mode, 1000, 1000, ours));
  for (const unsigned mode : {0440U, 0640U}) {
    EXPECT_TRUE(is_private(mode, 0, 2000, ours)) << "a Kubernetes secret with fsGroup 2000";
    EXPECT_FALSE(is_private(mode, 0, 3000, ours)) << "another group's";
    EXPECT_FALSE(is_private(mode, 1000, 1000, ours)) << "whose group is everybody's on many hosts";
  }
  for (const unsigned mode : {0660U, 0450U, 0444U, 0604U, 0601U}) EXPECT_FALSE(is_private(mode, 0, 2000, ours));
}

TEST(FolderOf, AFileMustBeThere) {
  for (const char* file : {"", "status.json", "/tmp/status.json"}) EXPECT_TRUE(check_folder_of(file)) << file;
  const Status none = check_folder_of("/nonexistent/b.json");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().message, "/nonexistent/b.json: there is no folder /nonexistent");
}

}  // namespace
}  // namespace ledgerline
