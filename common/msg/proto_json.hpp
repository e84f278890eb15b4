#pragma once
#include <google/protobuf/message.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <string>
#include <string_view>

#include "common/base/result.hpp"
#include "common/base/text.hpp"
#include "common/msg/contract.hpp"

/// The two forms of every message of the contract: protobuf bytes, or the same message as JSON text. A call, its answer
/// and its event have one form; a reader of events must accept both (a person may `stop` a drone with JSON or plain
/// strings, whose event is JSON).
namespace ledgerline {

/// JSON begins with "{", which no message of ledgerline.proto does (it would be a group of field 15).
inline bool is_json(std::string_view bytes) { return !bytes.empty() && bytes.front() == '{'; }

/// Whether an argument is no message but a plain string: an id, a drone, "prefix/*", a bookmark with ":", or an option
/// with "=". No message of ours is only of such characters in protobuf.
inline bool is_plain(std::string_view arg) {
  return std::all_of(arg.begin(), arg.end(),
                     [](char c) { return contract::is_id_char(c) || c == '*' || c == ':' || c == '='; });
}

/// The same JSON with the names that its fields have today: what stands in quotes before a colon is a name.
inline std::string with_current_fields(std::string_view bytes) {
  std::string text(bytes);
  for (const auto& [before, now] : contract::fields_before) {
    const std::string quoted = "\"" + std::string(before) + "\"";
    for (auto at = text.find(quoted); at != std::string::npos; at = text.find(quoted, at + 1)) {
      const auto behind = text.find_first_not_of(" \t\r\n", at + quoted.size());
      if (behind != std::string::npos && text[behind] == ':') text.replace(at + 1, before.size(), now);
    }
  }
  return text;
}

/// Fills `message` from either form; JSON with fields of today's names, or of those that blocks written before hold.
/// Unknown JSON fields are an error.
inline Status parse_message(std::string_view bytes, google::protobuf::Message& message) {
  if (!is_json(bytes)) {
    if (message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return done;
    return Error{"not a " + message.GetDescriptor()->name() + " in protobuf"};
  }
  message.Clear();
  const auto status = google::protobuf::util::JsonStringToMessage(with_current_fields(bytes), &message);
  if (status.ok()) return done;
  const auto why = status.message();  // quotes the text, as it is
  return Error{"not a " + message.GetDescriptor()->name() + " in JSON: " + printable({why.data(), why.size()})};
}

/// As JSON, fields that are zero left out.
inline std::string to_json(const google::protobuf::Message& message) {
  std::string text;
  // Only a broken Any makes this fail, and no message of ours has one.
  if (!google::protobuf::util::MessageToJsonString(message, &text).ok()) text = "{}";
  return text;
}

}  // namespace ledgerline
