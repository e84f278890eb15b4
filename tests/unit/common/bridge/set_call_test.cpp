#include "common/bridge/core/set_call.hpp"

#include <gtest/gtest.h>

#include "ledgerline.pb.h"

namespace ledgerline::bridge {
namespace {

const std::string some_cdr("\0\1\0\0\5\0\0\0", 8);

std::string one_call() {
  std::string call;
  append_asset(call, {.id = "Org1MSP/a", .type = "p/msg/A", .cdr = some_cdr, .origin = {1, 2, 300, -4}});
  append_asset(call, {.id = "Org1MSP/b", .type = "p/msg/B", .cdr = {}, .origin = {1, 2, 1, 0}});
  append_stream(call);
  return call;
}

TEST(BridgeSetCall, IsTheSetCallOfTheContract) {
  SetCall call;
  ASSERT_TRUE(call.ParseFromString(one_call()));
  ASSERT_EQ(call.assets_size(), 2);
  EXPECT_EQ(call.assets(0).id(), "Org1MSP/a");
  EXPECT_EQ(call.assets(0).msg_type(), "p/msg/A");
  EXPECT_EQ(call.assets(0).msg_data(), some_cdr);
  EXPECT_EQ(call.assets(0).origin().writer(), 1U);
  EXPECT_EQ(call.assets(0).origin().life(), 2U);
  EXPECT_EQ(call.assets(0).origin().sequence(), 300U);
  EXPECT_EQ(call.assets(0).origin().stamp_ns(), -4);
  EXPECT_TRUE(call.stream());
}

TEST(BridgeSetCall, ReadsWhatProtobufWrote) {
  SetCall call;
  ASSERT_TRUE(call.ParseFromString(one_call()));
  const std::string bytes = call.SerializeAsString();
  SetView view;
  ASSERT_TRUE(read_set(bytes, view).ok());
  ASSERT_EQ(view.assets.size(), 2U);
  EXPECT_EQ(view.assets[0].cdr, some_cdr);
  EXPECT_EQ(view.assets[0].origin.sequence, 300U);
  EXPECT_EQ(view.assets[0].origin.stamp_ns, -4);
  EXPECT_EQ(view.assets[1].type, "p/msg/B");
  EXPECT_TRUE(view.stream);
}

TEST(BridgeSetCall, FieldsOfANewerVersionArePassedOver) {
  SetCall call;
  ASSERT_TRUE(call.ParseFromString(one_call()));
  for (google::protobuf::Message* message :
       {static_cast<google::protobuf::Message*>(&call), static_cast<google::protobuf::Message*>(call.mutable_assets(0)),
        static_cast<google::protobuf::Message*>(call.mutable_assets(0)->mutable_origin())}) {
    message->GetReflection()->MutableUnknownFields(message)->AddLengthDelimited(99, "of tomorrow");
    message->GetReflection()->MutableUnknownFields(message)->AddVarint(98, 7);
  }
  const std::string bytes = call.SerializeAsString();
  SetView view;
  ASSERT_TRUE(read_set(bytes, view).ok());
  EXPECT_EQ(view.assets.size(), 2U);
  EXPECT_EQ(view.assets[0].origin.sequence, 300U);
}

TEST(BridgeSetCall, WhatIsCutOffAnywhereIsRefusedOrHasFewerAssets) {
  const std::string whole = one_call();
  SetView view;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const Status status = read_set(std::string_view(whole).substr(0, size), view);
    SetCall call;
    EXPECT_EQ(status.ok(), call.ParseFromString(whole.substr(0, size))) << size;
    EXPECT_TRUE(status.ok() || view.assets.empty());
  }
}

}  // namespace
}  // namespace ledgerline::bridge
