#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// anchor and verify: data that is kept elsewhere (video, recordings), by its hash.
namespace ledgerline::chaincode {
namespace {

Result<AnchorCall> read_anchor(const Arguments& call, const std::string& function) {
  AnchorCall asked;
  if (call.form == Arguments::Form::plain) return Error{function + ": give an AnchorCall in protobuf or JSON"};
  if (Status status = parse_message(call.message, asked); !status) return Error{function + ": " + status.error().what};
  if (asked.digest().size() != contract::digest_bytes) {
    return Error{function + ": digest has " + std::to_string(asked.digest().size()) + " bytes; a SHA-256 has " +
                 std::to_string(contract::digest_bytes)};
  }
  if (asked.what().size() > contract::max_anchor_chars) {
    return Error{function + ": what has " + std::to_string(asked.what().size()) + " characters; the limit is " +
                 std::to_string(contract::max_anchor_chars)};
  }
  return asked;
}

}  // namespace

Response anchor(Stub& stub, const Arguments& call) {
  const auto asked = read_anchor(call, contract::anchor);
  if (!asked) return refuse(asked.error().what);
  // A key for each who anchors it: nobody is kept out, and nobody changes another's word.
  const std::string key = anchor_key(asked->digest(), stub.caller());
  const auto known = read_stored(stub, key);
  if (!known) return refuse(known.error().what);
  if (*known)
    return refuse("anchor: " + to_text(stub.caller()) + " has anchored this digest already; verify says when");
  if (Status status = write_record(stub, key, *asked); !status) return refuse(status.error().what);
  stub.set_event(contract::anchor, write_form(call, *asked));
  return {};
}

Response verify(Stub& stub, const Arguments& call) {
  const auto asked = read_anchor(call, contract::verify);
  if (!asked) return refuse(asked.error().what);
  const std::string start = anchors_prefix(asked->digest());
  const auto found = stub.get_range(start, end_of(start), contract::max_page_anchors);
  if (!found) return refuse(found.error().what);
  Anchors anchors;
  for (const KeyValue& entry : *found) {
    Stored stored;
    if (!stored.ParseFromString(entry.value)) return refuse("the record " + entry.key + " is damaged");
    const auto anchored = parse_record<AnchorCall>(entry.key, stored);
    if (!anchored) return refuse(anchored.error().what);
    const auto versions = stub.get_history(entry.key, 0, 1);
    if (!versions) return refuse(versions.error().what);
    Anchor& one = *anchors.add_anchors();
    *one.mutable_signer() = stored.signer();
    one.set_what(anchored->what());
    if (versions->empty()) continue;  // a peer without a history database
    one.set_tx_id(versions->front().tx_id);
    one.set_timestamp_ns(versions->front().timestamp_ns);
  }
  return {200, {}, write_form(call, anchors)};
}

}  // namespace ledgerline::chaincode
