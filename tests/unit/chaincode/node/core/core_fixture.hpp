#pragma once
#include <gmock/gmock.h>

#include "tests/unit/chaincode/node/core/fake_network.hpp"

namespace ledgerline::node {

/// A network in which tello1 is enrolled to `host`.
class CoreTest : public ::testing::Test {
 protected:
  CoreTest() { net.submit(net.admin1, "enroll", enroll_call(net.host.name, {"tello1"})); }

  Reply evaluate(const std::string& function, const std::string& arg) {
    return net.core->evaluate(net.propose(net.pilot, function, arg).signed_proposal, net.now);
  }

  std::string value_of(const std::string& id) {
    const Reply reply = evaluate("get", id);
    protos::Response response;
    if (reply.code != Code::ok || !response.ParseFromString(reply.bytes)) return reply.detail;
    Asset asset;
    EXPECT_TRUE(parse_message(response.payload(), asset).ok());
    return asset.msg_data();
  }

  FakeNetwork net;
};

}  // namespace ledgerline::node
