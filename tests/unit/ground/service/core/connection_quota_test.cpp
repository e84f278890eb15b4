#include "ground/service/core/connection_quota.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <deque>
#include <random>
#include <vector>

namespace ledgerline::ground::service {
namespace {

using Use = ConnectionQuota::Use;

TEST(ConnectionQuota, AnOnlookersAddressHasEightAndHalfOfThemForRequests) {
  ConnectionQuota quota;
  const ConnectionQuota::Owner here{"192.0.2.1"}, there{"192.0.2.2"};
  std::size_t requests = 0, streams = 0;
  while (quota.acquire(here, Use::request)) ++requests;
  while (quota.acquire(here, Use::stream)) ++streams;
  EXPECT_EQ(requests, 4U);
  EXPECT_EQ(requests + streams, 8U);
  EXPECT_TRUE(quota.acquire(there, Use::stream));
  quota.release(here);
  EXPECT_TRUE(quota.acquire(here, Use::stream));
  EXPECT_FALSE(quota.acquire(here, Use::stream));
}

TEST(ConnectionQuota, WhateverOnlookersTakeAnOperatorKeepsTwo) {
  ConnectionQuota quota;
  std::size_t taken = 0;
  for (int address = 0; address < 100; ++address) {
    while (quota.acquire({std::to_string(address)}, Use::stream)) ++taken;
  }
  EXPECT_EQ(taken, ConnectionQuota::max_shared);
  for (const std::size_t who : {0U, 1U}) {
    EXPECT_TRUE(quota.acquire({"192.0.2.9", who}, Use::stream));
    EXPECT_TRUE(quota.acquire({"198.51.100.7", who}, Use::request)) << "wherever he connects from";
    EXPECT_FALSE(quota.acquire({"192.0.2.9", who}, Use::stream)) << "the rest is shared";
  }
  quota.release({"0"});
  EXPECT_TRUE(quota.acquire({"192.0.2.9", 0}, Use::stream));
  quota.release({"192.0.2.9", 0});
  EXPECT_TRUE(quota.acquire({"1000"}, Use::stream)) << "what was shared is again";
}

TEST(ConnectionQuota, AHostOfIpv6IsOneAddressWhicheverOfItsOwnItUses) {
  EXPECT_EQ(address_of("2001:db8::1"), address_of("2001:db8::ffff:2"));
  EXPECT_NE(address_of("2001:db8:0:1::1"), address_of("2001:db8::1"));
  EXPECT_NE(address_of("::ffff:192.0.2.1"), address_of("::ffff:192.0.2.2"));
  EXPECT_EQ(address_of("192.0.2.1"), "192.0.2.1");
  EXPECT_EQ(address_of("fe80::1%eth0"), address_of("fe80::2"));
}

/// One client among those that a client makes who connects `per_s` times a second, for `for_ms`; how often it is
/// still there of so many tries.
int stays(int per_s, int for_ms, bool same_address, int tries) {
  std::mt19937_64 random(1);
  int stayed = 0;
  for (int k = 0; k < tries; ++k) {
    std::deque<UnauthenticatedClient> all(max_unauthenticated, {"192.0.2.1"});
    const auto one_more = [&](std::string_view address) {
      all.erase(all.begin() + static_cast<std::ptrdiff_t>(displaced_by_next(
                                  std::vector<UnauthenticatedClient>(all.begin(), all.end()), random())));
      all.push_back({address});
    };
    const char* const mine = "192.0.2.77";
    one_more(mine);
    const auto is_mine = [&](const UnauthenticatedClient& one) { return one.address.data() == mine; };
    for (int i = 0; i < per_s * for_ms / 1000; ++i) {
      if (same_address) {  // counted as one of the others
        std::vector<UnauthenticatedClient> alike(all.size(), {"192.0.2.1"});
        all.erase(all.begin() + static_cast<std::ptrdiff_t>(displaced_by_next(alike, random())));
        all.push_back({"192.0.2.1"});
      } else {
        one_more("192.0.2.1");
      }
    }
    stayed += std::any_of(all.begin(), all.end(), is_mine);
  }
  return stayed;
}

TEST(UnauthenticatedStreams, OneThatNeedsThreeRoundTripsStaysBesideAThousandConnectionsASecond) {
  EXPECT_EQ(stays(1500, 120, true, 50), 50) << "they come in bursts";
  EXPECT_GT(stays(2000, 120, true, 50), 5) << "beyond that it is drawn";
  EXPECT_EQ(stays(10'000, 500, false, 20), 20) << "from another address it always stays";
}

TEST(UnauthenticatedStreams, WhoHasEndedItsHandshakeIsNotDisplacedByWhoHasNot) {
  std::vector<UnauthenticatedClient> all(10, {"192.0.2.1", true});
  all[4].has_ended_handshake = false;
  for (std::uint64_t random = 0; random < 20; ++random) EXPECT_EQ(displaced_by_next(all, random), 4U);
  all[4].has_ended_handshake = true;
  all[9].address = "192.0.2.2";
  for (std::uint64_t random = 0; random < 20; ++random) EXPECT_LT(displaced_by_next(all, random), 5U);
}

TEST(UnauthenticatedStreams, AddressesThatHaveAsManyAreDrawnFromAlike) {
  std::vector<UnauthenticatedClient> all{{"192.0.2.1"}, {"192.0.2.2"}, {"192.0.2.3"}, {"192.0.2.4"}};
  EXPECT_EQ(displaced_by_next(all, 0), 0U);
  EXPECT_EQ(displaced_by_next(all, 1), 1U);
}

}  // namespace
}  // namespace ledgerline::ground::service
