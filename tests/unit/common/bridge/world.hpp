#pragma once
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "common/bridge/core/downlink.hpp"
#include "common/bridge/core/uplink.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

namespace ledgerline::bridge::testing {

using agent::testing::LedgerOfTests;

inline const crypto::IdentityName org1{"Org1MSP", "CN=User1@org1.ledgerline"};
inline const crypto::IdentityName org2{"Org2MSP", "CN=User1@org2.ledgerline"};

inline Rule rule(const std::string& name, int priority = 5, std::size_t queue = 256) {
  Rule rule;
  rule.name = name;
  rule.to_ledger = rule.from_ledger = true;
  rule.from = "*";
  rule.priority = priority;
  rule.queue = queue;
  rule.depth = 10;
  return rule;
}

inline UplinkConfig uplink_config(std::vector<Rule> rules) {
  UplinkConfig config;
  config.rules = std::move(rules);
  config.enrolled = {"tello1"};
  config.msp_id = org1.msp_id;
  config.writer = writer_of(org1, "");
  config.life = 1;
  return config;
}

/// CDR of a std_msgs/msg/String, or of whatever has these bytes.
inline std::string cdr(const std::string& text) { return std::string("\0\1\0\0", 4) + text; }
inline std::span<const std::uint8_t> bytes(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

inline SetCall parsed(const Uplink::Submit& submit) {
  SetCall call;
  EXPECT_TRUE(call.ParseFromString(submit.call.args.at(0)));
  return call;
}
/// "id=text" of each asset.
inline std::vector<std::string> texts(const Uplink::Submit& submit) {
  std::vector<std::string> all;
  const SetCall call = parsed(submit);
  for (const Asset& asset : call.assets()) all.push_back(asset.id() + "=" + asset.msg_data().substr(4));
  return all;
}

inline fabric::Outcome ended(fabric::Outcome::Kind kind, const std::string& message = {}) {
  fabric::Outcome outcome = fabric::Outcome::failed(kind, message);
  outcome.ordered_after_ns = 2 * ns_per_ms;
  return outcome;
}

}  // namespace ledgerline::bridge::testing
