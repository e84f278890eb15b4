#include "common/base/check.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline {
namespace {

using testing::MatchesRegex;

TEST(Check, SaysFilePlaceMeaningAndValues) {
  const int from = 3, until = 2;
  try {
    LEDGERLINE_CHECK(from < until, "a plan covers some time", from, until);
    FAIL() << "nothing was thrown";
  } catch (const CheckFailed& failed) {
    EXPECT_THAT(failed.what(), MatchesRegex("check_test.cpp:[0-9]+: a plan covers some time \\(from < until\\), "
                                            "from, until = 3, 2"));
  }
}

TEST(Check, ReadsItsValuesOnlyWhenItFails) {
  int read = 0;
  EXPECT_TRUE(LEDGERLINE_CHECK(true, "it holds", ++read));
  EXPECT_EQ(read, 0);
}

TEST(Check, GoesOnUnderAScopeWhichKeepsTheFirst) {
  CheckLog log;
  {
    const CheckScope scope(log);
    EXPECT_FALSE(LEDGERLINE_CHECK(1 > 2, "the first"));
    EXPECT_FALSE(LEDGERLINE_CHECK(1 > 3, "the second"));
  }
  EXPECT_EQ(log.failures(), 2u);
  EXPECT_THAT(log.first(), MatchesRegex(".*: the first \\(1 > 2\\)"));
  EXPECT_THROW(LEDGERLINE_CHECK(1 > 2, "behind the scope"), CheckFailed);
}

TEST(Check, InnerScopesGiveBackTheOuterOne) {
  CheckLog outer, inner;
  const CheckScope scope(outer);
  {
    const CheckScope within(inner);
    LEDGERLINE_CHECK(false, "of the inner one");
  }
  LEDGERLINE_CHECK(false, "of the outer one");
  EXPECT_THAT(outer.first(), testing::HasSubstr("of the outer one"));
  EXPECT_THAT(inner.first(), testing::HasSubstr("of the inner one"));
}

}  // namespace
}  // namespace ledgerline
