#include "common/msg/cdr.hpp"

#include <gtest/gtest.h>

namespace ledgerline {
namespace {

std::string bytes(std::initializer_list<int> values) {
  std::string out;
  for (const int v : values) out.push_back(static_cast<char>(v));
  return out;
}

TEST(CdrWriter, AlignsEachPrimitiveToItsSizeBehindTheHeader) {
  CdrWriter out;
  out.put(std::uint8_t{1});
  out.put(std::uint16_t{0x0203});
  out.put(std::uint8_t{4});
  out.put(std::uint32_t{0x05060708});
  out.put(std::uint8_t{9});
  out.put(std::uint64_t{0x0a0b0c0d0e0f1011});
  const std::string header = bytes({0, 1, 0, 0});  // CDR, little-endian
  EXPECT_EQ(out.release(), header + bytes({1, 0, 3, 2, 4, 0, 0, 0, 8, 7, 6, 5, 9, 0, 0, 0}) +
                               bytes({0x11, 0x10, 0x0f, 0x0e, 0x0d, 0x0c, 0x0b, 0x0a}));
}

TEST(CdrWriter, StringsCarryTheirLengthAndNul) {
  CdrWriter out;
  out.put(std::string_view("map"));
  out.put(std::string_view(""));
  EXPECT_EQ(out.release(), bytes({0, 1, 0, 0, 4, 0, 0, 0, 'm', 'a', 'p', 0, 1, 0, 0, 0, 0}));
}

TEST(CdrReader, ReadsBothByteOrders) {
  const std::string little =
      bytes({0, 1, 0, 0, 1, 0, 3, 2, 8, 7, 6, 5, 2, 0, 0, 0, 'a', 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f});
  const std::string big =
      bytes({0, 0, 0, 0, 1, 0, 2, 3, 5, 6, 7, 8, 0, 0, 0, 2, 'a', 0, 0, 0, 0x3f, 0xf0, 0, 0, 0, 0, 0, 0});
  for (const std::string& text : {little, big}) {
    CdrReader in(text);
    EXPECT_EQ(in.get<std::uint8_t>(), 1);
    EXPECT_EQ(in.get<std::uint16_t>(), 0x0203);
    EXPECT_EQ(in.get<std::uint32_t>(), 0x05060708U);
    EXPECT_EQ(in.get_string(), "a");
    EXPECT_EQ(in.get<double>(), 1.0);
    EXPECT_TRUE(in.ok());
  }
}

TEST(CdrReader, WhatWasWrittenComesBack) {
  CdrWriter out;
  out.put(std::uint8_t{7});
  out.put(-1.5);
  out.put(std::string_view("odom"));
  out.put(std::array<float, 3>{1, 2, 3});
  out.put(std::int64_t{-9});
  const std::string text = out.release();
  CdrReader in(text);
  EXPECT_EQ(in.get<std::uint8_t>(), 7);
  EXPECT_EQ(in.get<double>(), -1.5);
  EXPECT_EQ(in.get_string(), "odom");
  EXPECT_EQ((in.get_array<float, 3>()), (std::array<float, 3>{1, 2, 3}));
  EXPECT_EQ(in.get<std::int64_t>(), -9);
  EXPECT_TRUE(in.ok());
  (void)in.get<std::uint8_t>();
  EXPECT_FALSE(in.ok());
}

TEST(CdrReader, TruncatedAnywhereItSaysSoAndGivesZeros) {
  CdrWriter out;
  out.put(std::uint8_t{7});
  out.put(std::string_view("odometry"));
  out.put(2.5);
  const std::string whole = out.release();
  for (std::size_t cut = 0; cut < whole.size(); ++cut) {
    const std::string text = whole.substr(0, cut);
    CdrReader in(text);
    (void)in.get<std::uint8_t>();
    (void)in.get_string();
    EXPECT_EQ(in.get<double>(), 0.0);
    EXPECT_FALSE(in.ok()) << cut;
    EXPECT_EQ(in.get<std::uint32_t>(), 0U);
    EXPECT_EQ(in.get_string(), "");
  }
}

TEST(CdrReader, StringsThatCannotBeAreRefused) {
  for (const std::string& text : {bytes({0, 1, 0, 0, 0, 0, 0, 0}),  // length 0 has no room for the NUL
                                  bytes({0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 'a', 0}),  // longer than the bytes
                                  bytes({0, 1, 0, 0, 2, 0, 0, 0, 'a', 'b'})}) {         // no NUL
    CdrReader in(text);
    EXPECT_EQ(in.get_string(), "");
    EXPECT_FALSE(in.ok());
  }
}

TEST(CdrReader, AnotherEncodingIsRefused) {
  for (const std::string& text :
       {std::string(), bytes({0, 1}), bytes({0, 3, 0, 0, 1}), bytes({1, 1, 0, 0, 1}), bytes({0, 7, 0, 0, 1})}) {
    CdrReader in(text);
    EXPECT_EQ(in.get<std::uint8_t>(), 0);
    EXPECT_FALSE(in.ok());
  }
}

}  // namespace
}  // namespace ledgerline
