#include "common/base/text.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline {
namespace {

TEST(Endpoint, IsAHostAndAPort) {
  for (const char* text :
       {"127.0.0.1:7051", "peer0.org1.example.com:1", "tower:65535", "[::1]:7051", "cc_service:9999"})
    EXPECT_TRUE(check_endpoint(text)) << text;
  EXPECT_TRUE(check_endpoint("0.0.0.0:0", 0));
}

TEST(Endpoint, WhatIsNoneIsRefusedWithTheReason) {
  for (const char* text : {"", "cc", ":7051", "cc:", "cc:x", "cc:99999", "cc:72587", "cc:-1", "cc:0", "cc:7051x",
                           "::1:7051", "grpc://cc:9999", "cc:9999/path", "c c:9999"}) {
    const Status status = check_endpoint(text);
    ASSERT_FALSE(status) << text;
    EXPECT_THAT(status.error().message, testing::HasSubstr(text));
  }
  EXPECT_THAT(check_endpoint("grpcs://cc:9999").error().message, testing::HasSubstr("no grpc://"));
  EXPECT_THAT(check_endpoint("cc:70510").error().message, testing::HasSubstr("65535"));
}

}  // namespace
}  // namespace ledgerline
