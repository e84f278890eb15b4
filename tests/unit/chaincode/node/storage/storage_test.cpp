#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <functional>

#include "chaincode/node/storage/block_store.hpp"

namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class StorageTest : public ::testing::Test {
 protected:
  /// Opens the store and notes what it says.
  Result<std::unique_ptr<BlockStore>> open(Files& files) {
    blocks.clear();
    messages.clear();
    return BlockStore::open(
        files,
        [this](std::string_view block) -> Status {
          blocks.emplace_back(block);
          return done;
        },
        [this](const std::string& message) { messages.push_back(message); });
  }

  void write(const std::vector<std::string>& all) {
    auto store = open(memory);
    ASSERT_TRUE(store.ok());
    for (const std::string& block : all) ASSERT_TRUE((*store)->append(block).ok());
  }

  std::string& bytes() { return memory.content("blocks").bytes; }

  MemoryFiles memory;
  std::vector<std::string> blocks, messages;
};

TEST_F(StorageTest, BlocksAreThereAfterAReopen) {
  write({"zero", "one", std::string(100'000, 'x')});
  const auto store = open(memory);
  ASSERT_TRUE(store.ok());
  EXPECT_THAT(blocks, ElementsAre("zero", "one", std::string(100'000, 'x')));
  EXPECT_THAT(messages, IsEmpty());
  EXPECT_EQ((*store)->height(), 3U);
  EXPECT_EQ(*(*store)->read(1), "one");
  EXPECT_FALSE((*store)->read(3).ok());
}

TEST_F(StorageTest, AppendReturnsOnlyWhenTheBlockSurvivesLossOfPower) {
  write({"zero", "one"});
  memory.cut_power();
  ASSERT_TRUE(open(memory).ok());
  EXPECT_THAT(blocks, ElementsAre("zero", "one"));
}

TEST_F(StorageTest, ATornTailIsCutOffWithAMessageWhereverItTore) {
  write({"zero", "one"});
  const std::string whole = bytes();
  write({"two"});
  const std::string longer = bytes();
  for (std::size_t size = whole.size() + 1; size < longer.size(); ++size) {
    bytes() = longer.substr(0, size);
    auto store = open(memory);
    ASSERT_TRUE(store.ok()) << size;
    EXPECT_THAT(blocks, ElementsAre("zero", "one"));
    EXPECT_THAT(messages, ElementsAre(HasSubstr("block 2 was not finished")));
    EXPECT_EQ(bytes(), whole);
    ASSERT_TRUE((*store)->append("new").ok());
    ASSERT_TRUE(open(memory).ok());
    EXPECT_THAT(blocks, ElementsAre("zero", "one", "new"));
  }
}

TEST_F(StorageTest, WhatAKillLeftUnsyncedIsOnDiskBeforeReadersSeeItAgain) {
  write({"zero", "one"});
  memory.content("blocks").synced = 0;  // written, but the kill came before the sync
  ASSERT_TRUE(open(memory).ok());
  EXPECT_THAT(blocks, ElementsAre("zero", "one"));
  memory.cut_power();
  ASSERT_TRUE(open(memory).ok());
  EXPECT_THAT(blocks, ElementsAre("zero", "one"));
}

TEST_F(StorageTest, ATailOfZerosIsCutOff) {
  write({"zero"});
  bytes() += std::string(5000, '\0');
  ASSERT_TRUE(open(memory).ok());
  EXPECT_THAT(blocks, ElementsAre("zero"));
  EXPECT_THAT(messages, ElementsAre(HasSubstr("5000 bytes cut off")));
}

TEST_F(StorageTest, DamageBeforeGoodBlocksIsAnErrorThatNamesThePlace) {
  write({"zero", "one", "two"});
  const std::string whole = bytes();
  const std::size_t record = whole.size() - std::string("two").size() - 24;  // where the last record begins
  for (std::size_t at = 0; at < record; ++at) {
    bytes() = whole;
    bytes()[at] = static_cast<char>(bytes()[at] ^ 0x40);
    const auto store = open(memory);
    ASSERT_FALSE(store.ok()) << at;
    EXPECT_THAT(store.error().message, HasSubstr("is damaged at byte"));
    EXPECT_EQ(bytes().size(), whole.size()) << "nothing is cut off";
  }
}

TEST_F(StorageTest, AnUnfinishedBlockThatHoldsARecordOfAnotherFileIsCutOff) {
  MemoryFiles elsewhere;
  ASSERT_TRUE((*open(elsewhere))->append("a member's own record").ok());
  write({"zero", "begin " + elsewhere.content("blocks").bytes + " and a long end"});
  bytes().resize(bytes().size() - 5);
  ASSERT_TRUE(open(memory).ok());
  EXPECT_THAT(blocks, ElementsAre("zero"));
  EXPECT_THAT(messages, ElementsAre(HasSubstr("block 1 was not finished")));
}

TEST_F(StorageTest, AFileThatIsNoLedgerIsLeftAlone) {
  write({});
  for (const std::size_t size : {1, 5, 28, 200}) {
    const std::string other(size, 'x');
    bytes() = other;
    const auto store = open(memory);
    ASSERT_FALSE(store.ok());
    EXPECT_THAT(store.error().message, HasSubstr("no ledger of this version"));
    EXPECT_EQ(bytes(), other);
  }
}

TEST_F(StorageTest, AnUnfinishedBeginStartsAgain) {
  write({});
  const std::string head = bytes();
  for (std::size_t size = 1; size < head.size(); ++size) {
    bytes() = head.substr(0, size);
    ASSERT_TRUE((*open(memory))->append("zero").ok()) << size;
    ASSERT_TRUE(open(memory).ok());
    EXPECT_THAT(blocks, ElementsAre("zero"));
  }
}

TEST_F(StorageTest, WhatTheReaderRefusesIsAnError) {
  write({"zero"});
  const auto store = BlockStore::open(
      memory, [](std::string_view) -> Status { return Error{"block 0 does not fit"}; }, [](const std::string&) {});
  ASSERT_FALSE(store.ok());
  EXPECT_THAT(store.error().message, HasSubstr("block 0 does not fit"));
}

/// A disk that fails at the n-th sync.
class FailingFiles final : public Files {
 public:
  class FailingFile final : public File {
   public:
    explicit FailingFile(int& left) : left_(left) {}
    Status append(std::string_view) override { return done; }
    Status sync() override {
      if (left_-- > 0) return done;
      return Error{"the disk is gone"};
    }
    Result<std::string> read(std::uint64_t, std::size_t) const override { return Error{"unused"}; }
    Result<std::uint64_t> size() const override { return std::uint64_t{0}; }
    Status truncate(std::uint64_t) override { return done; }

   private:
    int& left_;
  };
  explicit FailingFiles(int good_syncs) : left_(good_syncs) {}
  Result<std::unique_ptr<File>> open(const std::string&) override {
    return std::unique_ptr<File>(std::make_unique<FailingFile>(left_));
  }
  std::string place() const override { return "failing"; }

 private:
  int left_;
};

TEST_F(StorageTest, AfterAFailedSyncNothingMoreIsTaken) {
  FailingFiles files(2);  // the file's head, and one block
  auto store = open(files);
  ASSERT_TRUE(store.ok());
  EXPECT_TRUE((*store)->append("zero").ok());
  EXPECT_THAT((*store)->append("one").error().message, HasSubstr("the disk is gone"));
  EXPECT_FALSE((*store)->append("two").ok());
  EXPECT_EQ((*store)->height(), 1U);
}

TEST_F(StorageTest, AFullDiskTakesNothingOfABlockAndTheSameBlockWhenThereIsRoom) {
  auto store = open(memory);
  ASSERT_TRUE(store.ok());
  ASSERT_TRUE((*store)->append("zero").ok());
  const std::string before = bytes();
  memory.content("blocks").room = before.size() + 30;
  for (int i = 0; i < 2; ++i) {
    EXPECT_THAT((*store)->append("one, and more").error().message, HasSubstr("no room"));
    EXPECT_TRUE((*store)->full());
    EXPECT_EQ(bytes(), before);
  }
  EXPECT_EQ((*store)->height(), 1U);
  memory.content("blocks").room = SIZE_MAX;
  EXPECT_TRUE((*store)->append("one, and more").ok());
  EXPECT_FALSE((*store)->full());
  memory.cut_power();
  ASSERT_TRUE(open(memory).ok());
  EXPECT_THAT(blocks, ElementsAre("zero", "one, and more"));
  EXPECT_THAT(messages, IsEmpty());
}

class DiskTest : public StorageTest {
 protected:
  DiskTest() : dir_(std::filesystem::temp_directory_path() / ("ledgerline_disk_" + std::to_string(::getpid()))) {
    std::filesystem::remove_all(dir_);
  }
  ~DiskTest() override { std::filesystem::remove_all(dir_); }
  std::filesystem::path dir_;
};

TEST_F(DiskTest, ARealDirectoryKeepsTheChainToo) {
  {
    auto files = open_directory(dir_);
    ASSERT_TRUE(files.ok());
    auto store = open(**files);
    ASSERT_TRUE(store.ok());
    ASSERT_TRUE((*store)->append("zero").ok());
    ASSERT_TRUE((*store)->append("one").ok());
    EXPECT_EQ(*(*store)->read(1), "one");
  }
  std::filesystem::resize_file(dir_ / "blocks", std::filesystem::file_size(dir_ / "blocks") - 1);
  auto files = open_directory(dir_);
  ASSERT_TRUE(files.ok());
  auto store = open(**files);
  ASSERT_TRUE(store.ok());
  EXPECT_THAT(blocks, ElementsAre("zero"));
  ASSERT_TRUE((*store)->append("again").ok());
  EXPECT_EQ(*(*store)->read(1), "again");
}

TEST_F(DiskTest, ADirectoryHasOneProcess) {
  const auto first = open_directory(dir_);
  ASSERT_TRUE(first.ok());
  const auto second = open_directory(dir_);
  ASSERT_FALSE(second.ok());
  EXPECT_THAT(second.error().message, HasSubstr("in use by another ledgerline-node"));
}

/// What `action` says when it runs without root's powers, in a process of its own.
std::string said_by_nobody(const std::function<std::string()>& action) {
  int out[2];
  EXPECT_EQ(::pipe(out), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const bool dropped = ::geteuid() != 0 || (::setgid(65534) == 0 && ::setuid(65534) == 0);
    const std::string said = dropped ? action() : "cannot become nobody";
    const bool reported = ::write(out[1], said.data(), said.size()) == static_cast<ssize_t>(said.size());
    ::_exit(reported ? 0 : 1);
  }
  ::close(out[1]);
  std::string said(4096, '\0');
  const ssize_t size = ::read(out[0], said.data(), said.size());
  said.resize(size > 0 ? static_cast<std::size_t>(size) : 0);
  ::close(out[0]);
  ::waitpid(child, nullptr, 0);
  return said;
}

TEST_F(DiskTest, ADirectoryThatCannotBeWrittenIsNamedAndKeepsItsBlocks) {
  const auto owner = std::filesystem::perms::owner_all;
  std::filesystem::create_directories(dir_);
  if (::geteuid() == 0) {
    ASSERT_EQ(::chown(dir_.c_str(), 65534, 65534), 0);
  }
  const auto append = [&]() -> std::string {
    auto files = open_directory(dir_);
    if (!files) return files.error().message;
    auto store = open(**files);
    if (!store) return store.error().message;
    const Status status = (*store)->append("zero");
    return status ? "good" : status.error().message;
  };
  EXPECT_EQ(said_by_nobody(append), "good");
  const auto size = std::filesystem::file_size(dir_ / "blocks");
  std::filesystem::permissions(dir_, std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
  std::filesystem::permissions(dir_ / "blocks", std::filesystem::perms::owner_read);
  EXPECT_EQ(said_by_nobody(append), "opening " + (dir_ / "blocks").string() + ": Permission denied");
  std::filesystem::permissions(dir_ / "lock", std::filesystem::perms::none);
  EXPECT_EQ(said_by_nobody(append), "opening " + (dir_ / "lock").string() + ": Permission denied");
  EXPECT_EQ(std::filesystem::file_size(dir_ / "blocks"), size);
  std::filesystem::permissions(dir_, owner);
  std::filesystem::permissions(dir_ / "lock", owner);
  std::filesystem::permissions(dir_ / "blocks", owner);
  EXPECT_EQ(said_by_nobody(append), "good") << "nothing was lost";
}

TEST_F(DiskTest, ADirectoryOfAnotherUserIsRefused) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can give a directory away";
  std::filesystem::create_directories(dir_);
  ASSERT_EQ(::chown(dir_.c_str(), 65534, 65534), 0);
  const auto files = open_directory(dir_);
  ASSERT_FALSE(files.ok());
  EXPECT_THAT(files.error().message, HasSubstr(dir_.string() + " belongs to user 65534, and this is user 0"));
  EXPECT_TRUE(std::filesystem::is_empty(dir_));
}

}  // namespace
}  // namespace ledgerline::node
