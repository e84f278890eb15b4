#include "common/crypto/identities/wiping_string.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <type_traits>

namespace ledgerline::crypto {
namespace {

static_assert(!std::is_copy_constructible_v<WipingString> && !std::is_copy_assignable_v<WipingString>);

TEST(WipingString, WipesTheWholeBufferOfWhatItIsMadeOf) {
  std::string phrase = "a pass phrase of more than any inline buffer";
  phrase.resize(20);  // its tail still lies in the buffer
  const char* const buffer = phrase.data();
  const std::size_t capacity = phrase.capacity();
  const WipingString secret(std::move(phrase));
  EXPECT_EQ(secret.view(), "a pass phrase of mor");
  EXPECT_STREQ(secret.c_str(), "a pass phrase of mor");
  EXPECT_TRUE(std::all_of(buffer, buffer + capacity, [](char c) { return c == '\0'; }));

  std::string small = "short";  // within the string itself
  const WipingString other(std::move(small));
  EXPECT_EQ(other.view(), "short");
  EXPECT_TRUE(std::all_of(small.data(), small.data() + small.capacity(), [](char c) { return c == '\0'; }));
}

TEST(WipingString, MovesAndLeavesNothing) {
  WipingString one(std::string_view("one")), other(std::string_view("other"));
  other = std::move(one);
  EXPECT_EQ(other.view(), "one");
  EXPECT_TRUE(one.empty());
  const WipingString third(std::move(other));
  EXPECT_EQ(third.size(), 3U);
  EXPECT_TRUE(other.empty());
  EXPECT_STREQ(other.c_str(), "");
}

}  // namespace
}  // namespace ledgerline::crypto
