#pragma once
#include <gtest/gtest.h>

#include <string>

#include "peer/chaincode_shim.pb.h"
#include "peer/proposal_response.pb.h"

/// What a peer says to a chaincode, and reads from it, in tests.
namespace ledgerline::shim {

inline protos::ChaincodeMessage message(protos::ChaincodeMessage::Type type, const std::string& payload,
                                        const std::string& tx) {
  protos::ChaincodeMessage out;
  out.set_type(type);
  out.set_payload(payload);
  out.set_txid(tx);
  out.set_channel_id("teleop");
  return out;
}

/// Of a transaction that ended well.
inline protos::Response response_in(const protos::ChaincodeMessage& end) {
  protos::Response response;
  EXPECT_EQ(end.type(), protos::ChaincodeMessage::COMPLETED) << end.payload();
  EXPECT_TRUE(response.ParseFromString(end.payload()));
  return response;
}

}  // namespace ledgerline::shim
