#include "common/rt/trace.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>

namespace ledgerline {
namespace {

class Trace : public testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(path_); }
  static TraceRecord record(std::uint64_t i) {
    TraceRecord r;
    r.t_ns = static_cast<TimeNs>(i) * 1000;
    r.kind = TraceKind::command_applied;
    r.drone = static_cast<std::uint16_t>(i % 16);
    r.extra = static_cast<std::uint32_t>(i * 3);
    r.id = i;
    r.stamp_ns = -static_cast<TimeNs>(i);
    r.v[0] = 0.5 * static_cast<double>(i);
    r.v[3] = -1;
    return r;
  }
  void write(std::uint64_t count, std::uint64_t max = 1'000'000) {
    auto writer = TraceWriter::create(path_, max);
    ASSERT_TRUE(writer) << writer.error().message;
    for (std::uint64_t i = 0; i < count; ++i) writer->add(record(i));
    dropped_ = writer->dropped();
  }
  void expect_records(std::uint64_t count) const {
    const auto records = read_trace(path_);
    ASSERT_TRUE(records) << records.error().message;
    ASSERT_EQ(records->size(), count);
    for (std::uint64_t i = 0; i < count; ++i) {
      const TraceRecord wanted = record(i);
      EXPECT_EQ(std::memcmp(&(*records)[i], &wanted, sizeof wanted), 0) << i;
    }
  }

  std::string path_ = testing::TempDir() + "trace" + std::to_string(::getpid());
  std::uint64_t dropped_ = 0;
};

TEST_F(Trace, ComesBackAsItWasWritten) {
  for (const std::uint64_t count : {0U, 1U, 255U, 256U, 257U, 1000U}) {  // around the buffer's size
    write(count);
    expect_records(count);
  }
}

TEST_F(Trace, ATornLastRecordIsLeftOut) {
  write(3);
  const auto size = std::filesystem::file_size(path_);
  for (std::uintmax_t torn = 1; torn < sizeof(TraceRecord); torn += 9) {
    std::filesystem::resize_file(path_, size - torn);
    expect_records(2);
    write(3);
  }
}

TEST_F(Trace, AReaderFollowsWhileItGrows) {
  auto writer = TraceWriter::create(path_);
  ASSERT_TRUE(writer);
  auto reader = TraceReader::open(path_);
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_TRUE(reader->read_new()->empty());
  for (std::uint64_t i = 0; i < 5; ++i) {
    writer->add(record(i));
    ASSERT_TRUE(writer->flush());
    const auto fresh = reader->read_new();
    ASSERT_TRUE(fresh);
    ASSERT_EQ(fresh->size(), 1U);
    EXPECT_EQ(fresh->front().id, i);
  }
  const auto size = std::filesystem::file_size(path_);
  writer->add(record(5));
  ASSERT_TRUE(writer->flush());
  std::filesystem::resize_file(path_, size + 10);  // the writer was in the middle of it
  EXPECT_TRUE(reader->read_new()->empty());
}

TEST_F(Trace, WhatIsOlderThanASecondIsInTheFile) {
  auto writer = TraceWriter::create(path_);
  ASSERT_TRUE(writer);
  TraceRecord r = record(1);
  for (int i = 0; i <= 10; ++i) {
    r.t_ns = i * 110 * ns_per_ms;
    writer->add(r);
  }
  EXPECT_EQ(read_trace(path_)->size(), 11U);
}

TEST_F(Trace, BeyondItsBoundRecordsAreOnlyCounted) {
  write(10, 4);
  EXPECT_EQ(dropped_, 6U);
  expect_records(4);
}

TEST_F(Trace, AnotherFileIsRefusedByName) {
  std::ofstream(path_) << "this is not a trace, but it is long enough for a header";
  EXPECT_NE(read_trace(path_).error().message.find(path_), std::string::npos);
  std::filesystem::resize_file(path_, 3);
  EXPECT_FALSE(read_trace(path_));
  EXPECT_FALSE(read_trace(path_ + ".none"));
}

TEST_F(Trace, AFileThatCannotBeMadeIsAnErrorThatNamesIt) {
  auto writer = TraceWriter::create("/nowhere/agent.trace");
  ASSERT_FALSE(writer);
  EXPECT_NE(writer.error().message.find("/nowhere/agent.trace"), std::string::npos);
}

TEST_F(Trace, AFullDiskIsReportedAndTheRestCounted) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full here";
  auto writer = TraceWriter::create("/dev/full");
  // The header goes out at once.
  ASSERT_FALSE(writer);
  EXPECT_NE(writer.error().message.find("No space left"), std::string::npos);
}

TEST_F(Trace, AMovedWriterWritesOn) {
  auto first = TraceWriter::create(path_).value();
  first.add(record(0));
  TraceWriter second = std::move(first);
  second.add(record(1));
  ASSERT_TRUE(second.flush());
  expect_records(2);
}

}  // namespace
}  // namespace ledgerline
