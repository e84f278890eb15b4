#include <algorithm>
#include <map>

#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// anchor and verify: data that is kept elsewhere (video, recordings), by its hash.
namespace ledgerline::chaincode {
namespace {

Result<AnchorCall> read_anchor(const Arguments& call, const std::string& function) {
  AnchorCall asked;
  if (call.form == Arguments::Form::plain) return Error{function + ": give an AnchorCall in protobuf or JSON"};
  if (Status status = parse_message(call.message, asked); !status)
    return Error{function + ": " + status.error().message};
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

/// What one verify answers, as far as it has come.
class AnchorPage {
 public:
  explicit AnchorPage(Stub& stub) : stub_(stub) {}

  Status add(const std::string& key, const Stored& stored) {
    const auto anchored = parse_record<AnchorCall>(key, stored);
    if (!anchored) return anchored.error();
    const auto versions = stub_.get_history(key, 0, 1);
    if (!versions) return versions.error();
    Anchor& one = *anchors.add_anchors();
    *one.mutable_signer() = stored.signer();
    one.set_what(anchored->what());
    if (versions->empty()) return done;  // a peer without a history database
    one.set_tx_id(versions->front().tx_id);
    one.set_timestamp_ns(versions->front().timestamp_ns);
    return done;
  }
  bool is_full() const { return static_cast<std::size_t>(anchors.anchors_size()) >= contract::max_page_anchors; }

  Anchors anchors;

 private:
  Stub& stub_;
};

Status find_signers(Stub& stub, const AnchorCall& asked, AnchorPage& page) {
  for (const Identity& signer : asked.signers()) {
    for (const std::string& key :
         {anchor_key(asked.digest(), to_name(signer)), anchor_key_before(asked.digest(), to_name(signer))}) {
      const auto stored = read_stored(stub, key);
      if (!stored) return stored.error();
      if (!*stored) continue;
      if (Status status = page.add(key, **stored); !status) return status;
      break;
    }
  }
  return done;
}

/// Everybody's, or one organisation's, in the order of their keys. Where everybody is asked for, an organisation that
/// has more than its part is left with the rest of it, and the next one begins.
Status find_all(Stub& stub, const AnchorCall& asked, AnchorPage& page) {
  constexpr std::size_t step = 16;
  constexpr std::size_t max_looked_at = 4 * contract::max_page_anchors;  // those of before are passed one by one
  const std::string digest = asked.digest(), all = anchors_prefix(digest);
  const bool of_one = !asked.organisation().empty();
  const std::string prefix = of_one ? organisation_anchors_prefix(digest, asked.organisation()) : all;
  const std::string end = end_of(prefix);
  std::string start = asked.bookmark().empty() ? prefix : std::max(prefix, all + asked.bookmark() + '\0');
  std::map<std::string, std::size_t> answered;
  for (std::size_t looked = 0; start < end;) {
    const auto some = stub.get_range(start, end, step);
    if (!some) return some.error();
    bool skipped = false;
    for (const KeyValue& entry : *some) {
      if (page.is_full() || ++looked > max_looked_at) {
        if (start.back() == '\0') start.pop_back();
        page.anchors.set_bookmark(start.substr(all.size()));
        return done;
      }
      start = entry.key + '\0';
      Stored stored;
      if (!stored.ParseFromString(entry.value)) return Error{"the record " + entry.key + " is damaged"};
      const std::string& msp_id = stored.signer().msp_id();
      if (of_one || answered[msp_id]++ < contract::max_organisation_anchors) {
        if (Status status = page.add(entry.key, stored); !status) return status;
        continue;
      }
      if (answered[msp_id] == contract::max_organisation_anchors + 1) page.anchors.add_more_of(msp_id);
      const std::string own = organisation_anchors_prefix(digest, msp_id);
      if (!entry.key.starts_with(own)) continue;
      start = end_of(own);
      skipped = true;
      break;
    }
    if (!skipped && some->size() < step) return done;
  }
  return done;
}

}  // namespace

Answer anchor(Stub& stub, const Arguments& call) {
  const auto asked = read_anchor(call, contract::anchor);
  if (!asked) return asked.error();
  if (asked->signers_size() > 0 || !asked->organisation().empty() || !asked->bookmark().empty())
    return Error{"anchor: signers, organisation and bookmark are of verify alone; leave them out"};
  // A key for each who anchors it: nobody is kept out, and nobody changes another's word.
  const std::string key = anchor_key(asked->digest(), stub.caller());
  for (const std::string& one : {key, anchor_key_before(asked->digest(), stub.caller())}) {
    const auto known = read_stored(stub, one);
    if (!known) return known.error();
    if (!*known) continue;
    return Error{"anchor: " + to_text(stub.caller()) + " has anchored this digest already; verify says when"};
  }
  if (Status status = write_record(stub, key, *asked); !status) return status.error();
  stub.set_event(contract::anchor, write_form(call, *asked));
  return std::string();
}

Answer verify(Stub& stub, const Arguments& call) {
  const auto asked = read_anchor(call, contract::verify);
  if (!asked) return asked.error();
  const auto signers = static_cast<std::size_t>(asked->signers_size());
  if (Status status = check_limit("verify: it asks for", signers, "signers", contract::max_page_anchors); !status)
    return status.error();
  if (signers > 0 && (!asked->organisation().empty() || !asked->bookmark().empty()))
    return Error{"verify: signers are answered all at once; leave organisation and bookmark out"};
  if (!asked->organisation().empty()) {
    if (Status status = check_id(asked->organisation()); !status) return Error{"verify: " + status.error().message};
  }
  AnchorPage page(stub);
  const Status found = signers > 0 ? find_signers(stub, *asked, page) : find_all(stub, *asked, page);
  if (!found) return found.error();
  return write_form(call, page.anchors);
}

}  // namespace ledgerline::chaincode
