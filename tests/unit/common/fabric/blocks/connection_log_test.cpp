#include "common/fabric/blocks/block_subscription.hpp"

#include <gtest/gtest.h>

namespace ledgerline::fabric {
namespace {

constexpr TimeNs begin_ns = 1'000 * ns_per_s;
using Word = std::optional<std::string>;

TEST(ConnectionLog, TellEachChangeOfAStreamThatIsRarelyLost) {
  ConnectionLog words;
  EXPECT_EQ(words.line(true, "", begin_ns), Word("connected"));
  EXPECT_EQ(words.line(false, "gone", begin_ns + ns_per_s), Word("gone"));
  EXPECT_EQ(words.line(true, "", begin_ns + 2 * ns_per_s), Word("connected"));
  const TimeNs later_ns = begin_ns + 2 * ConnectionLog::max_rest_ns;
  EXPECT_EQ(words.line(false, "gone", later_ns), Word("gone"));
  EXPECT_EQ(words.line(true, "", later_ns + 1), Word("connected"));
}

TEST(ConnectionLog, AreFewWhereEachConnectionIsRefusedAtOnce) {
  ConnectionLog words;
  int lines = 0;
  for (int second = 0; second < 3'600; ++second) {
    const TimeNs now = begin_ns + second * ns_per_s;
    lines += words.line(true, "", now) ? 1 : 0;
    lines += words.line(false, "refused: FORBIDDEN", now + 1) ? 1 : 0;
  }
  EXPECT_GE(lines, 2 * 30) << "it is not forgotten either";
  EXPECT_LE(lines, 2 * 37);
}

TEST(ConnectionLog, SayHowOftenItWasLostSince) {
  ConnectionLog words;
  (void)words.line(false, "refused", begin_ns);
  EXPECT_EQ(words.line(false, "refused", begin_ns + ns_per_s), Word());
  EXPECT_EQ(words.line(false, "refused", begin_ns + 2 * ns_per_s),
            Word("refused (1 times more since it was reported)"));
}

TEST(ConnectionLog, TellAnotherReasonAtOnce) {
  ConnectionLog words;
  EXPECT_EQ(words.line(false, "refused", begin_ns), Word("refused"));
  EXPECT_EQ(words.line(false, "not reached", begin_ns + 1), Word("not reached"));
}

TEST(ConnectionLog, ReportOnceThatItIsBackWhereLossesWereNotReported) {
  ConnectionLog words;
  (void)words.line(false, "refused", begin_ns);
  EXPECT_EQ(words.line(true, "", begin_ns + 1), Word("connected"));
  EXPECT_EQ(words.line(false, "refused", begin_ns + 2), Word());
  EXPECT_EQ(words.line(true, "", begin_ns + 3), Word()) << "the last line says so already";
}

}  // namespace
}  // namespace ledgerline::fabric
