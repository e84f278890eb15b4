#include "chaincode/node/server/calls.hpp"

#include <google/protobuf/any.pb.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>

#include "gateway/gateway.pb.h"

namespace ledgerline::node {
namespace {

/// google.rpc.Status { int32 code = 1; string message = 2; repeated Any details = 3 }: no package has it compiled.
std::string rpc_status(int code, const std::string& message, const google::protobuf::Any& detail) {
  using google::protobuf::internal::WireFormatLite;
  std::string bytes;
  google::protobuf::io::StringOutputStream stream(&bytes);
  google::protobuf::io::CodedOutputStream out(&stream);
  WireFormatLite::WriteInt32(1, code, &out);
  WireFormatLite::WriteString(2, message, &out);
  WireFormatLite::WriteBytes(3, detail.SerializeAsString(), &out);
  out.Trim();
  return bytes;
}

}  // namespace

grpc::Status make_status(grpc::StatusCode code, const std::string& message, const std::string& detail) {
  if (detail.empty()) return {code, message};
  gateway::ErrorDetail error;
  error.set_address("ledgerline-node");
  error.set_msp_id("Org1MSP");
  error.set_message(detail);
  google::protobuf::Any any;
  any.set_type_url("type.googleapis.com/gateway.ErrorDetail");
  any.set_value(error.SerializeAsString());
  return {code, message, rpc_status(code, message, any)};
}

grpc::Status make_status(const Reply& reply) {
  if (reply.code == Code::ok) return grpc::Status::OK;
  return make_status(static_cast<grpc::StatusCode>(reply.code), reply.message, reply.detail);
}

grpc::Status overloaded() {
  return make_status(grpc::StatusCode::RESOURCE_EXHAUSTED, "the node has too many requests waiting; try again");
}

}  // namespace ledgerline::node
