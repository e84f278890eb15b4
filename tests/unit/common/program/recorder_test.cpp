#include "common/program/program.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include "common/base/file.hpp"

namespace ledgerline {
namespace {

std::string file_named(const std::string& name) { return testing::TempDir() + name + std::to_string(::getpid()); }

TEST(Recorder, WritesTheTraceAndTheSummary) {
  const std::string trace = file_named("trace"), summary = file_named("summary");
  Recorder recorder;
  ASSERT_TRUE(recorder.open(trace));
  TraceRecord record;
  record.t_ns = 5;
  recorder.add({&record, 1});
  ASSERT_TRUE(recorder.end(summary, [] { return "{}"; }));
  EXPECT_EQ(read_trace(trace)->at(0).t_ns, 5);
  EXPECT_EQ(*read_file(summary), "{}\n");
  ::unlink(trace.c_str());
  ::unlink(summary.c_str());
}

TEST(Recorder, WritesNothingThatIsNotAskedFor) {
  Recorder recorder;
  EXPECT_TRUE(recorder.open(""));
  const TraceRecord record;
  recorder.add({&record, 1});
  EXPECT_TRUE(recorder.end("", []() -> std::string {
    ADD_FAILURE() << "nobody asked for a summary";
    return "";
  }));
}

TEST(Recorder, AFileThatCannotBeWrittenIsAnErrorThatNamesIt) {
  Recorder recorder;
  EXPECT_FALSE(recorder.open("/dev/null/trace"));
  const auto ended = recorder.end("/dev/null/summary", [] { return "{}"; });
  ASSERT_FALSE(ended);
  EXPECT_EQ(ended.error().message, "cannot write /dev/null/summary: Not a directory");
}

}  // namespace
}  // namespace ledgerline
