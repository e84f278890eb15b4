#pragma once
#include <google/protobuf/message_lite.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include <string>

/// Messages come and go as bytes: what does not parse is refused in Fabric's words (gRPC's own C++ refusal has none),
/// and a block that many read is written out once.
namespace ledgerline::node {

inline bool parse(const grpc::ByteBuffer& buffer, google::protobuf::MessageLite& message) {
  grpc::Slice bytes;
  return buffer.DumpToSingleSlice(&bytes).ok() && message.ParseFromArray(bytes.begin(), static_cast<int>(bytes.size()));
}

inline grpc::ByteBuffer to_buffer(const google::protobuf::MessageLite& message) {
  grpc::Slice bytes(message.ByteSizeLong());
  message.SerializeWithCachedSizesToArray(const_cast<std::uint8_t*>(bytes.begin()));
  return {&bytes, 1};
}

inline grpc::ByteBuffer to_buffer(const std::string& message) {
  const grpc::Slice bytes(message);
  return {&bytes, 1};
}

inline grpc::Status unparsable(const std::string& type) {
  return {grpc::StatusCode::INTERNAL, "grpc: error unmarshalling request: it is no " + type};
}

}  // namespace ledgerline::node
