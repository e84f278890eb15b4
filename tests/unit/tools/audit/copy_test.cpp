#include "tools/audit/source.hpp"

#include <gmock/gmock.h>

#include <filesystem>

#include "chaincode/node/storage/block_store.hpp"
#include "common/base/file.hpp"

namespace ledgerline::audit {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class CopyTest : public ::testing::Test {
 protected:
  CopyTest() {
    fs::remove_all(folder);
    fs::create_directories(folder);
  }
  ~CopyTest() override { fs::remove_all(folder); }

  void make_store(const std::vector<std::string>& all) {
    const auto files = node::open_directory(folder);
    ASSERT_TRUE(files) << files.error().message;
    const auto store = node::BlockStore::open(
        **files, [](std::string_view) -> Status { return done; }, [](const std::string&) {});
    ASSERT_TRUE(store) << store.error().message;
    for (const std::string& block : all) ASSERT_TRUE((*store)->append(block));
  }
  Result<Reading> read(const std::string& path) {
    return read_copy(path, [this](std::string_view block) { blocks.emplace_back(block); });
  }

  const std::string folder = (fs::temp_directory_path() / ("audit_copy_" + std::to_string(::getpid()))).string();
  std::vector<std::string> blocks;
};

TEST_F(CopyTest, ANodesFileIsReadAndNotTouched) {
  make_store({"one", "two"});
  const std::string before = *read_file(folder + "/blocks");
  for (const std::string& path : {folder, folder + "/blocks"}) {
    blocks.clear();
    const auto reading = read(path);
    ASSERT_TRUE(reading) << reading.error().message;
    EXPECT_EQ(reading->blocks, 2U);
    EXPECT_EQ(reading->problem, "");
    EXPECT_THAT(blocks, ElementsAre("one", "two"));
  }
  EXPECT_EQ(*read_file(folder + "/blocks"), before);
}

TEST_F(CopyTest, ANodesAndAFlightsFolderHaveTheFileFurtherIn) {
  make_store({"one", "two"});
  for (const std::string inside : {"/ledger", "/ledger/ledger"}) {
    fs::create_directories(folder + "/run" + inside);
    fs::copy_file(folder + "/blocks", folder + "/run" + inside + "/blocks");
    ASSERT_TRUE(read(folder + "/run")) << inside;
    EXPECT_THAT(blocks, ElementsAre("one", "two")) << inside;
    fs::remove_all(folder + "/run");
    blocks.clear();
  }
}

TEST_F(CopyTest, APathThatCannotBeLookedAtIsAnErrorWithTheSystemsWords) {
  const auto absent = read(folder + "/nothing");
  ASSERT_FALSE(absent);
  EXPECT_THAT(absent.error().message, HasSubstr("No such file or directory"));
  const auto refused = read(folder + "/" + std::string(300, 'x'));
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("File name too long"));
}

TEST_F(CopyTest, AFileThatEndsTooSoonSaysSoAndStaysAsItIs) {
  make_store({"one", "two"});
  const std::string cut = read_file(folder + "/blocks")->substr(0, fs::file_size(folder + "/blocks") - 1);
  ASSERT_TRUE(write_file(folder + "/blocks", cut));
  const auto reading = read(folder);
  ASSERT_TRUE(reading);
  EXPECT_THAT(blocks, ElementsAre("one"));
  EXPECT_THAT(reading->problem, HasSubstr("ends in the middle"));
  EXPECT_EQ(*read_file(folder + "/blocks"), cut);
}

TEST_F(CopyTest, ADamagedFileSaysWhere) {
  make_store({"one", "two", "three"});
  std::string bytes = *read_file(folder + "/blocks");
  bytes[bytes.find("two")] ^= 1;
  ASSERT_TRUE(write_file(folder + "/blocks", bytes));
  const auto reading = read(folder);
  ASSERT_TRUE(reading);
  EXPECT_THAT(blocks, ElementsAre("one"));
  EXPECT_THAT(reading->problem, HasSubstr("(block 1)"));
  EXPECT_THAT(reading->problem, ::testing::StartsWith(folder + "/blocks is damaged"));
  fs::rename(folder + "/blocks", folder + "/kept");
  EXPECT_THAT(read(folder + "/kept")->problem, ::testing::StartsWith(folder + "/kept is damaged"));
}

TEST_F(CopyTest, AFolderOfBlocksIsReadInTheirOrder) {
  for (std::uint64_t i = 0; i < 12; ++i) ASSERT_TRUE(save_block(folder, i, std::to_string(i)));
  const auto reading = read(folder);
  ASSERT_TRUE(reading);
  EXPECT_EQ(reading->blocks, 12U);
  EXPECT_EQ(blocks[10], "10");
}

TEST_F(CopyTest, AGapInAFolderIsReportedAndNotPassedOver) {
  for (const std::uint64_t i : {0, 1, 3}) ASSERT_TRUE(save_block(folder, i, std::to_string(i)));
  const auto reading = read(folder);
  ASSERT_TRUE(reading);
  EXPECT_THAT(blocks, ElementsAre("0", "1"));
  EXPECT_THAT(reading->problem, HasSubstr("the copy goes on to block 3"));
  fs::remove(folder + "/0.block");
  blocks.clear();
  const auto without_first = read(folder);
  ASSERT_TRUE(without_first) << without_first.error().message;
  EXPECT_EQ(without_first->blocks, 0U);
  EXPECT_THAT(without_first->problem, HasSubstr("0.block"));
}

TEST_F(CopyTest, AFlightsFolderOnFabricIsNoneAndSaysHowToMakeOne) {
  fs::create_directories(folder + "/run/ledger/done");
  for (const std::string inside : {"/run", "/run/ledger"}) {
    const auto reading = read(folder + inside);
    ASSERT_FALSE(reading);
    EXPECT_THAT(reading.error().message, HasSubstr("ledgerline fabric up --dir " + folder + "/run/ledger`"));
    EXPECT_THAT(reading.error().message, HasSubstr("--config " + folder + "/run/operator.toml --save copy`"));
  }
}

TEST_F(CopyTest, WhatIsNoCopyIsAnError) {
  EXPECT_FALSE(read(folder));
  EXPECT_FALSE(read(folder + "/nothing"));
  ASSERT_TRUE(write_file(folder + "/text", "no blocks"));
  EXPECT_FALSE(read(folder + "/text"));
}

}  // namespace
}  // namespace ledgerline::audit
