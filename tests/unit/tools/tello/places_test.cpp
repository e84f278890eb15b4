#include "tools/tello/core/dialogue.hpp"

#include <gtest/gtest.h>

#include "common/base/text.hpp"

namespace ledgerline::tello {
namespace {

TEST(Places, ASubnetIsItsHostsWithoutItsEnds) {
  const auto all = hosts_of("192.168.1.77/24");
  ASSERT_TRUE(all) << all.error().message;
  ASSERT_EQ(all->size(), 254U);
  EXPECT_EQ(ipv4_text(all->front()), "192.168.1.1");
  EXPECT_EQ(ipv4_text(all->back()), "192.168.1.254");
  EXPECT_EQ(hosts_of("10.0.0.4/30")->size(), 2U);
  EXPECT_EQ(hosts_of("10.0.0.4/31")->size(), 2U);
  EXPECT_EQ(hosts_of("10.0.0.4/32")->size(), 1U);
}

TEST(Places, WhatIsNoSmallSubnetIsRefused) {
  for (const char* text : {"", "192.168.1.0", "192.168.1.0/", "192.168.1.0/23", "10.0.0.0/8", "192.168.1.0/33",
                           "192.168.1.0/-1", "192.168.1.0/24x", "192.168.1/24", "tello/24"})
    EXPECT_FALSE(hosts_of(text)) << text;
}

TEST(Places, ANameOrPasswordThatTheDroneWouldCutIsRefused) {
  EXPECT_TRUE(check_wifi("lab", "password"));
  for (const char* ssid : {"", "my lab", "a\nb", "123456789012345678901234567890123"})
    EXPECT_FALSE(check_wifi(ssid, "password")) << ssid;
  for (const char* password : {"", "short", "pass word", "pass\tword"}) EXPECT_FALSE(check_wifi("lab", password));
  EXPECT_FALSE(check_wifi("lab", std::string(64, 'x')));
}

}  // namespace
}  // namespace ledgerline::tello
