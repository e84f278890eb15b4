#include "tools/timing/self_test.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "tools/timing/metrics.hpp"

namespace ledgerline::timing {
namespace {

using testing::HasSubstr;

TEST(SelfTest, CyclictestsHistogramIsRead) {
  const auto lateness = parse_cyclictest(
      "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n000003 000900\n000050 000099\n001001 000001\n"
      "# Total: 000001002\n# Min Latencies: 00003\n# Avg Latencies: 00009\n# Max Latencies: 05000\n"
      "# Histogram Overflows: 00002\n# Histogram Overflow at cycle number:\n# Thread 0: 5 6\n");
  ASSERT_TRUE(lateness) << lateness.error().message;
  EXPECT_EQ(lateness->late.count(), 1002U);
  EXPECT_EQ(lateness->overruns, 3U);
  EXPECT_EQ(lateness->late.quantile(0.5), 3 * ns_per_us);
  EXPECT_EQ(lateness->late.max(), 5 * ns_per_ms);
}

TEST(SelfTest, WithoutAHistogramItSaysWhatCyclictestPrinted) {
  EXPECT_THAT(parse_cyclictest("ERROR: mlockall\n").error().message, HasSubstr("ERROR: mlockall"));
}

TEST(SelfTest, IsGoodWhereTheLoopIsAboutAsPunctualAsCyclictest) {
  SelfTest test;
  EXPECT_EQ(criterion(), "p99.9 of link's loop at most 200 us, and 1.5 times cyclictest's plus 50 us");
  EXPECT_FALSE(test.good()) << "nothing was measured";
  test.loop.late.add(150 * ns_per_us);
  EXPECT_TRUE(test.good());
  test.cyclictest.emplace().late.add(60 * ns_per_us);
  EXPECT_FALSE(test.good());
  test.cyclictest->late = {};
  test.cyclictest->late.add(70 * ns_per_us);
  EXPECT_TRUE(test.good());
  test.loop.late.add(201 * ns_per_us);
  EXPECT_FALSE(test.good());
}

TEST(SelfTest, SaysWhatIsMissingAndHowToGetIt) {
  SelfTest test;
  test.loop.late.add(150 * ns_per_us);
  test.real_time.notices = {"no SCHED_FIFO: Operation not permitted; grant CAP_SYS_NICE"};
  test.why_no_cyclictest = "cyclictest is not installed: apt-get install rt-tests";
  const std::string table = to_table(test);
  for (const char* part : {"link's loop, not FIFO", "grant CAP_SYS_NICE", "apt-get install rt-tests", "steal"})
    EXPECT_THAT(table, HasSubstr(part));
}

}  // namespace
}  // namespace ledgerline::timing
