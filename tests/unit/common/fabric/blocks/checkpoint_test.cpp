#include "common/fabric/blocks/checkpoint.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include <condition_variable>
#include <filesystem>
#include <mutex>

#include "common/base/file.hpp"

namespace ledgerline::fabric {
namespace {

using ::testing::HasSubstr;

class CheckpointFile : public ::testing::Test {
 protected:
  CheckpointFile() { std::filesystem::create_directories(dir_); }
  ~CheckpointFile() override { std::filesystem::remove_all(dir_); }
  std::string why_not() const {
    const auto read = read_checkpoint(path_, "teleop");
    return read ? "it was read" : read.error().message;
  }

  const std::string dir_ = ::testing::TempDir() + "/checkpoint_" + std::to_string(::getpid());
  const std::string path_ = dir_ + "/agent.checkpoint";
  const Checkpoint known_{"teleop", 123'456'789'012, std::string(31, '\xfe') + '\n',
                          std::string("any\nsum of bytes\0", 17)};
};

TEST_F(CheckpointFile, GivesBackWhatWasWrittenForItsOwnerAlone) {
  ASSERT_TRUE(write_checkpoint(path_, {"teleop", 1, std::string(32, 'a'), "older"}));
  ASSERT_TRUE(write_checkpoint(path_, known_));
  const auto read = read_checkpoint(path_, "teleop");
  ASSERT_TRUE(read && *read) << why_not();
  EXPECT_EQ((*read)->channel, known_.channel);
  EXPECT_EQ((*read)->number, known_.number);
  EXPECT_EQ((*read)->hash, known_.hash);
  EXPECT_EQ((*read)->records, known_.records);
  struct stat info {};
  ASSERT_EQ(::stat(path_.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);
}

TEST_F(CheckpointFile, ThatIsNotThereIsNone) {
  const auto read = read_checkpoint(path_, "teleop");
  ASSERT_TRUE(read);
  EXPECT_FALSE(*read);
}

TEST_F(CheckpointFile, WithAnyByteChangedOrMissingIsAnErrorThatSaysWhatToDo) {
  const std::string whole = to_text(known_);
  for (std::size_t i = 0; i < whole.size(); ++i) {
    std::string other = whole;
    other[i] = static_cast<char>(other[i] ^ 1);
    EXPECT_FALSE(checkpoint_from(other)) << i;
    EXPECT_FALSE(checkpoint_from(whole.substr(0, i))) << i;
  }
  EXPECT_FALSE(checkpoint_from(whole + "x"));
  ASSERT_TRUE(write_file(path_, whole.substr(0, whole.size() / 2)));
  EXPECT_THAT(why_not(), HasSubstr(path_ + ": it is damaged. Compare"));
  EXPECT_THAT(why_not(), HasSubstr("then remove the file"));
  ASSERT_TRUE(write_file(path_, ""));
  EXPECT_THAT(why_not(), HasSubstr("it cannot be read, or is empty. Compare"));
  ASSERT_TRUE(write_file(path_, "something else\n"));
  EXPECT_THAT(why_not(), HasSubstr("it is no checkpoint of this version"));
}

TEST_F(CheckpointFile, ThatCannotBeReadIsNotNone) {
  std::filesystem::create_directories(path_);
  EXPECT_THAT(why_not(), HasSubstr("it cannot be read, or is empty. Compare"));
  std::filesystem::remove_all(path_);
  std::filesystem::create_symlink(dir_ + "/nothing", path_);
  EXPECT_THAT(why_not(), HasSubstr("it cannot be read, or is empty. Compare"));
}

TEST_F(CheckpointFile, OfAnotherChannelIsAnError) {
  ASSERT_TRUE(write_checkpoint(path_, {"yard", 1, std::string(32, 'a'), {}}));
  EXPECT_THAT(why_not(), HasSubstr("it is of channel yard, not of teleop"));
}

TEST_F(CheckpointFile, KeepsTheNewestOfManyAndIsThereAtTheEnd) {
  {
    CheckpointWriter writer(path_, {}, 3600 * ns_per_s);
    for (std::uint64_t i = 1; i <= 1'000; ++i) writer.store({"teleop", i, std::string(32, 'a'), {}});
  }
  EXPECT_EQ((*read_checkpoint(path_, "teleop"))->number, 1'000U);
}

TEST_F(CheckpointFile, IsWrittenWithinAPeriodWhileItsKeeperLives) {
  CheckpointWriter writer(path_, {}, 1 * ns_per_ms);
  writer.store({"teleop", 1, std::string(32, 'a'), {}});
  const auto written = [&](std::uint64_t number) {
    const auto read = read_checkpoint(path_, "teleop");
    return read && *read && (*read)->number == number;
  };
  while (!written(1)) std::this_thread::sleep_for(std::chrono::milliseconds(1));  // ctest has a limit
  writer.store({"teleop", 2, std::string(32, 'a'), {}});
  while (!written(2)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

TEST_F(CheckpointFile, ThatCannotBeWrittenIsReportedOnce) {
  std::vector<std::string> problems;
  ASSERT_TRUE(write_file(dir_ + "/file", ""));
  {
    CheckpointWriter writer(
        dir_ + "/file/checkpoint", [&](const std::string& why) { problems.push_back(why); }, 0);
    for (int i = 0; i < 3; ++i) {
      writer.store({"teleop", 1, std::string(32, 'a'), {}});
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }
  ASSERT_EQ(problems.size(), 1U);
  EXPECT_THAT(problems[0], HasSubstr("Not a directory"));
}

}  // namespace
}  // namespace ledgerline::fabric
