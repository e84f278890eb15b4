#pragma once
#include <algorithm>
#include <cstddef>
#include <string>

#include "chaincode/contract/contract_common.hpp"

/// What get and history share.
namespace ledgerline::chaincode {

inline constexpr std::size_t history_step = 32;  ///< old values that are read at a time

inline Result<QueryCall> read_query(const Arguments& call) {
  QueryCall query;
  if (call.form == Arguments::Form::plain) {
    if (call.names.size() > 1) return Error{"give one id"};
    if (!call.names.empty()) query.set_id(call.names[0]);
    query.set_bookmark(call.option("bookmark", ""));
    return query;
  }
  if (Status status = parse_message(call.message, query); !status) return status.error();
  return query;
}

/// Bytes that a message takes in the answer; base64 and field names make JSON longer.
inline std::size_t size_in(const Arguments& call, const google::protobuf::Message& message) {
  const std::size_t bytes = message.ByteSizeLong();
  return call.json_out() ? bytes * 4 / 3 + 100 : bytes + 8;
}

inline bool is_record(const std::string& id) {
  return std::ranges::find(record_kinds, first_segment(id)) != record_kinds.end();
}

inline const Asset* find_in(const Stored& frame, const std::string& id) {
  for (const Asset& asset : frame.assets()) {
    if (asset.id() == id) return &asset;
  }
  return nullptr;
}

}  // namespace ledgerline::chaincode
