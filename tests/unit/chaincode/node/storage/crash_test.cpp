#include <gmock/gmock.h>

#include "chaincode/node/storage/block_store.hpp"
#include "common/base/random.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

/// The power fails at every write of a run: what was acknowledged is there afterwards, and the node goes on.
namespace ledgerline::node {
namespace {

constexpr int transactions = 500;
constexpr std::size_t sector = 512;

/// A disk in memory whose power fails in the n-th write: of what was not synced a part may have reached it.
class CrashFiles final : public Files {
 public:
  enum class Leaves { nothing, a_torn_end, holes };

  CrashFiles(MemoryFiles& disk, int fails_at) : disk_(disk), left_(fails_at) {}

  class CrashFile final : public File {
   public:
    CrashFile(std::unique_ptr<File> file, int& left) : file_(std::move(file)), left_(left) {}
    Status append(std::string_view bytes) override {
      if (left_ < 0) return Error{"no power"};
      Status written = file_->append(bytes);
      return left_-- == 0 ? Error{"no power"} : written;
    }
    Status sync() override { return left_ < 0 ? Error{"no power"} : file_->sync(); }
    Status truncate(std::uint64_t size) override { return left_ < 0 ? Error{"no power"} : file_->truncate(size); }
    Result<std::string> read(std::uint64_t offset, std::size_t size) const override {
      return file_->read(offset, size);
    }
    Result<std::uint64_t> size() const override { return file_->size(); }

   private:
    std::unique_ptr<File> file_;
    int& left_;
  };

  Result<std::unique_ptr<File>> open(const std::string& name) override {
    auto file = disk_.open(name);
    if (!file) return file.error();
    return std::unique_ptr<File>(std::make_unique<CrashFile>(std::move(*file), left_));
  }
  std::string place() const override { return "a disk without power"; }

 private:
  MemoryFiles& disk_;
  int left_;
};

void cut_power(MemoryFiles::Content& file, CrashFiles::Leaves leaves, Random& random) {
  const std::size_t unsynced = file.bytes.size() - file.synced;
  if (leaves == CrashFiles::Leaves::nothing || unsynced == 0) {
    file.bytes.resize(file.synced);
  } else if (leaves == CrashFiles::Leaves::a_torn_end) {
    file.bytes.resize(file.synced + random.next() % unsynced);
  } else {  // the disk wrote sectors in an order of its own
    for (std::size_t at = file.synced; at < file.bytes.size(); at += sector) {
      if (random.next() % 2 == 0) continue;
      const std::size_t size = std::min(sector, file.bytes.size() - at);
      file.bytes.replace(at, size, std::string(size, '\0'));
    }
  }
  file.synced = file.bytes.size();  // what is there now stays there
}

class CrashTest : public ::testing::Test {
 protected:
  CrashTest() {
    net.submit(net.admin1, "enroll", enroll_call(net.host.name, {"tello1"}));
    for (int i = 0; i < transactions; ++i) {
      const auto codes = net.submit(net.host, "set", note("tello1/note" + std::to_string(i % 7), std::to_string(i)));
      EXPECT_THAT(codes, ::testing::ElementsAre(0));
    }
  }

  /// A whole run that ends in the n-th write; returns how many blocks were acknowledged.
  std::size_t run_until(int write, MemoryFiles& disk) {
    CrashFiles files(disk, write);
    auto store = BlockStore::open(
        files, [](std::string_view) { return done; }, [](const std::string&) {});
    EXPECT_EQ(store.ok(), write > 0) << "the first write begins the file";
    std::size_t acknowledged = 0;
    if (!store) return acknowledged;
    while (acknowledged < net.chain.size() && (*store)->append(net.chain[acknowledged]).ok()) ++acknowledged;
    return acknowledged;
  }

  FakeNetwork net;
  Random random{7};
};

TEST_F(CrashTest, NoAcknowledgedBlockIsMissingWhereverThePowerFails) {
  using Leaves = CrashFiles::Leaves;
  const int writes = static_cast<int>(net.chain.size()) + 1;
  ASSERT_EQ(writes, transactions + 3);  // the file's head, the config block and the enrolment
  for (int write = 0; write < writes; ++write) {
    for (const Leaves leaves : {Leaves::nothing, Leaves::a_torn_end, Leaves::holes}) {
      MemoryFiles disk;
      const std::size_t acknowledged = run_until(write, disk);
      ASSERT_EQ(acknowledged, static_cast<std::size_t>(std::max(write - 1, 0)));
      cut_power(disk.content("blocks"), leaves, random);

      std::vector<std::string> found;
      const auto store = BlockStore::open(
          disk,
          [&](std::string_view block) -> Status {
            found.emplace_back(block);
            return done;
          },
          [](const std::string&) {});
      ASSERT_TRUE(store.ok()) << "write " << write << ": " << store.error().message;
      ASSERT_GE(found.size(), acknowledged) << "write " << write;
      ASSERT_LE(found.size(), acknowledged + 1);
      for (std::size_t i = 0; i < found.size(); ++i) ASSERT_EQ(found[i], net.chain[i]) << "write " << write;
      if (found.size() < net.chain.size()) {
        ASSERT_TRUE((*store)->append(net.chain[found.size()]).ok()) << "it goes on";
      }
    }
  }
}

TEST_F(CrashTest, ANodeKnowsEveryAcknowledgedTransactionAfterTheCrash) {
  for (int write = 0; write < static_cast<int>(net.chain.size()); write += 50) {
    MemoryFiles disk;
    const std::size_t acknowledged = run_until(write, disk);
    cut_power(disk.content("blocks"), CrashFiles::Leaves::a_torn_end, random);
    FakeNetwork after;
    after.chain.clear();
    const auto store = BlockStore::open(
        disk,
        [&](std::string_view block) -> Status {
          after.chain.emplace_back(block);
          return done;
        },
        [](const std::string&) {});
    ASSERT_TRUE(store.ok());
    if (acknowledged == 0) continue;
    after.restart();  // replays: checks numbers and the chain of hashes
    for (std::size_t i = 1; i < acknowledged; ++i) {
      for (const fabric::Transaction& tx : net.block(i).transactions) {
        const auto status = after.core->find(tx.tx_id);
        ASSERT_TRUE(status) << "block " << i << ", write " << write;
        EXPECT_EQ(status->code, 0);
        EXPECT_EQ(status->block, i);
      }
    }
  }
}

}  // namespace
}  // namespace ledgerline::node
