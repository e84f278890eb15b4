#include "common/base/enum_count.hpp"

#include <gtest/gtest.h>

#include <cstdint>

namespace ledgerline {
namespace {

enum class Plain { first, second, third };
enum class Small : std::uint8_t { none = 0, some = 1 };
enum class Empty {};
enum class Gap { first = 0, third = 2 };

// Of the compiler's words: this is compiled by each that the project is built with.
static_assert(enum_count<Plain> == 3);
static_assert(enum_count<Small> == 2);
static_assert(enum_count<Empty> == 0);
static_assert(enum_count<Gap> == 1, "only what is numbered without a gap is counted");
static_assert(is_enumerator<Plain::third>());
static_assert(!is_enumerator<static_cast<Plain>(3)>());
static_assert(!is_enumerator<static_cast<Plain>(-1)>());

static_assert(enum_name(Plain::third) == "third");
static_assert(enum_name(static_cast<Plain>(3)) == "unknown");

TEST(EnumCount, ATableWithoutAnEntryForEachValueIsSeen) {
  constexpr const char* names[] = {"first", "second"};
  EXPECT_NE(std::size(names), enum_count<Plain>);
}

}  // namespace
}  // namespace ledgerline
