#include "common/base/text.hpp"
#include "common/base/utc.hpp"

#include <gtest/gtest.h>

namespace ledgerline {
namespace {

TEST(ClearText, WhatAPersonCanReadStaysAsItIs) {
  EXPECT_EQ(printable(""), "");
  EXPECT_EQ(printable("tello1: not enrolled"), "tello1: not enrolled");
  EXPECT_EQ(printable("gr\xc3\xbc\xc3\x9f dich \xe2\x82\xac \xf0\x9f\x9a\x81"),
            "gr\xc3\xbc\xc3\x9f dich \xe2\x82\xac \xf0\x9f\x9a\x81");
}

TEST(ClearText, ControlCharactersAndBrokenUtf8AreShownAsQuestionMarks) {
  EXPECT_EQ(printable(std::string_view("a\nb\0c\x1b[2J\x7f", 10)), "a?b?c?[2J?");
  EXPECT_EQ(printable("a\xc2\x9b"
                      "2J\xc2\x85|\xe2\x80\xa8|\xc2\xa0"),
            "a?2J?|?|\xc2\xa0");
  EXPECT_EQ(printable("\xff|\xc0\x80|\xed\xa0\x80|\xf4\x90\x80\x80|\xe2\x82"), "?|??|???|????|??");
}

TEST(ClearText, LongTextIsCutBetweenCharacters) {
  EXPECT_EQ(printable(std::string(2'000, 'x')), std::string(997, 'x') + "...");
  EXPECT_EQ(printable("12345678", 8), "12345678");
  EXPECT_EQ(printable("123456789", 8), "12345...");
  EXPECT_EQ(printable("1234\xc3\xbc"
                      "6789",
                      8),
            "1234...");
}

TEST(Utf8, IsWhatConfigsCanHold) {
  EXPECT_TRUE(is_utf8(""));
  EXPECT_TRUE(is_utf8("caf\xc3\xa9 \"\\\n"));
  EXPECT_FALSE(is_utf8("caf\xe9"));
  EXPECT_FALSE(is_utf8("caf\xc3"));
}

TEST(ATime, IsOfTheClockOrInSeconds) {
  EXPECT_EQ(*parse_time_s("2023-11-14T22:13:20Z"), 1'700'000'000);
  EXPECT_EQ(*parse_time_s("1700000000"), 1'700'000'000);
  EXPECT_EQ(*parse_time_s("2023-11-14T23:13:20+01:00"), 1'700'000'000);
  EXPECT_EQ(*parse_time_ns("2023-11-14T23:13:20.5+01:00"), 1'700'000'000'500'000'000);
  for (const char* wrong : {"", "yesterday", "-5", "2023-11-14", "2023-11-14T22:13:20", "2023-11-14 22:13:20",
                            "1970-01-01T00:00:00+01:00", "99999999999999999999"})
    EXPECT_FALSE(parse_time_s(wrong)) << wrong;
}

TEST(ATime, MayHaveAFraction) {
  EXPECT_EQ(*parse_time_ns("2023-11-14T22:13:20Z"), 1'700'000'000'000'000'000);
  EXPECT_EQ(*parse_time_ns("2023-11-14T22:13:20.25Z"), 1'700'000'000'250'000'000);
  EXPECT_EQ(*parse_time_ns("1700000000.000000001"), 1'700'000'000'000'000'001);
  for (const char* wrong : {"", ".5", "1.", "1.5s", "-1.5", "1.0000000001", "2023-11-14.5T22:13:20Z"})
    EXPECT_FALSE(parse_time_ns(wrong)) << wrong;
}

}  // namespace
}  // namespace ledgerline
