#include "common/web/host_port.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::web {
namespace {

TEST(AHostAndPort, IsReadAndWrittenAsBrowsersDo) {
  for (const char* text : {"127.0.0.1:8800", "0.0.0.0:0", "ground.example.org:65535", "localhost:1", "[::1]:8800",
                           "[fd00::7]:443", "a-b.3com:1"})
    EXPECT_EQ(text_of(*host_port_from(text)), text);
  EXPECT_EQ(text_of(*host_port_from("[FD00:0:0::7]:1")), "[fd00::7]:1");
  EXPECT_EQ(host_port_from("[::1]:8800")->host, "::1");
}

TEST(AHostAndPort, IsNothingElse) {
  for (const char* wrong : {"",
                            ":",
                            "127.0.0.1",
                            "127.0.0.1:",
                            "127.0.0.1:65536",
                            "127.0.0.1:-1",
                            "127.0.0.1:8x",
                            "127.0.0.1: 8",
                            "::1:8800",
                            "[::1]",
                            "[::1:8800",
                            "[fe80::1%eth0]:1",
                            "Ground.example.org:1",
                            "a..b:1",
                            ".a:1",
                            "-a:1",
                            "a-:1",
                            "a_b:1",
                            "a/b:1",
                            "a@b:1",
                            "a b:1",
                            "127.0.0:1",
                            "1.2.3.4.5:1",
                            "256.1.1.1:1",
                            "0x7f000001:1x",
                            "7:1"})
    EXPECT_FALSE(host_port_from(wrong)) << wrong;
  EXPECT_FALSE(host_port_from(std::string(254, 'a') + ":1"));
}

TEST(AHost, OfThisComputerAloneIsAnAddressAndNoName) {
  for (const char* host : {"127.0.0.1", "127.8.9.10", "::1"}) EXPECT_TRUE(is_loopback(host)) << host;
  for (const char* host : {"localhost", "127.0.0.1.example.org", "0.0.0.0", "::", "10.0.0.1", "::ffff:127.0.0.1"})
    EXPECT_FALSE(is_loopback(host)) << host;
}

}  // namespace
}  // namespace ledgerline::web
