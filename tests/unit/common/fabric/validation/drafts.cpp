#include "tests/unit/common/fabric/validation/drafts.hpp"

#include "common/fabric/tx/policy.hpp"
#include "ledger/rwset/rwset.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

const std::string contract = "ledgerline";
const std::string garbage = "\xff\xff\xff";

template <typename Hook, typename... Layers>
void call(const Hook& hook, Layers&... layers) {
  if (hook) hook(layers...);
}

std::string results_of(const kvrwset::KVRWSet& set) {
  rwset::TxReadWriteSet results;
  rwset::NsReadWriteSet& own = *results.add_ns_rwset();
  own.set_namespace_(contract);
  own.set_rwset(set.SerializeAsString());
  return results.SerializeAsString();
}

void write(Draft& draft, const std::string& key, const std::string& value = "value") {
  kvrwset::KVWrite& one = *draft.set.add_writes();
  one.set_key(key);
  one.set_value(value);
}

void set_policy(Draft& draft, const std::string& key, const std::string& msp_id) {
  kvrwset::KVMetadataWrite& one = *draft.set.add_metadata_writes();
  one.set_key(key);
  if (msp_id.empty()) return;  // takes the policy away
  one.add_entries()->set_name(validation_parameter);
  one.mutable_entries(0)->set_value(peer_policy(msp_id));
}

void read(Draft& draft, const std::string& key, const std::optional<ChannelState::Key>& as) {
  kvrwset::KVRead& one = *draft.set.add_reads();
  one.set_key(key);
  if (!as) return;
  one.mutable_version()->set_block_num(as->version.block);
  one.mutable_version()->set_tx_num(as->version.tx);
}

void set_event(Draft& draft, const std::string& of_contract, const std::string& tx_id) {
  protos::ChaincodeEvent event;
  event.set_chaincode_id(of_contract);
  event.set_tx_id(tx_id);
  event.set_event_name("event");
  draft.action.set_events(event.SerializeAsString());
}

/// One more namespace in the results.
std::function<void(std::string&)> with_namespace(const std::string& name, bool writes) {
  return [=](std::string& results) {
    rwset::TxReadWriteSet all;
    all.ParseFromString(results);
    kvrwset::KVRWSet set;
    if (writes) {
      set.add_writes()->set_key("draft/foreign");
      set.mutable_writes(0)->set_value("value");
    } else {
      set.add_reads()->set_key("draft/never");
    }
    rwset::NsReadWriteSet& one = *all.add_ns_rwset();
    one.set_namespace_(name);
    one.set_rwset(set.SerializeAsString());
    results = all.SerializeAsString();
  };
}

/// Of the two signatures that a key can make of a message, the one that Fabric refuses.
void raise_s(protos::Endorsement& endorsement) {
  // DER: 30 len 02 len r 02 len s; n - s in place of s, with n of P-256.
  static const std::string order(
      "\xff\xff\xff\xff\x00\x00\x00\x00\xff\xff\xff\xff\xff\xff\xff\xff\xbc\xe6\xfa\xad\xa7\x17\x9e\x84\xf3\xb9\xca\xc2"
      "\xfc\x63"
      "\x25\x51",
      32);
  const std::string der = endorsement.signature();
  const std::size_t at = 4 + static_cast<unsigned char>(der[3]);
  std::string s = der.substr(at + 2);
  s.insert(0, 33 - s.size(), '\0');
  std::string high(33, '\0');
  int borrow = 0;
  for (int i = 32; i >= 1; --i) {
    const int digit = static_cast<unsigned char>(order[static_cast<std::size_t>(i - 1)]) -
                      static_cast<unsigned char>(s[static_cast<std::size_t>(i)]) - borrow;
    borrow = digit < 0 ? 1 : 0;
    high[static_cast<std::size_t>(i)] = static_cast<char>(digit & 0xff);
  }
  std::string out = der.substr(0, at) + '\x02' + '\x21' + high;
  out[1] = static_cast<char>(out.size() - 2);
  endorsement.set_signature(out);
}

}  // namespace

std::string Draft::seal() {
  common::SignatureHeader signature_header;
  signature_header.set_creator(creator->serialized);
  signature_header.set_nonce(nonce);
  std::string extension_bytes = extension.SerializeAsString();
  call(on_extension, extension_bytes);
  channel_header.set_extension(extension_bytes);
  channel_header.set_tx_id(transaction_id(signature_header));
  call(on_headers, channel_header, signature_header);
  common::Payload payload;
  payload.mutable_header()->set_channel_header(channel_header.SerializeAsString());
  payload.mutable_header()->set_signature_header(signature_header.SerializeAsString());
  std::string action_header = payload.header().signature_header();
  call(on_action_header, action_header);

  std::string results = results_of(set);
  call(on_results, results);
  action.set_results(results);
  const std::string asked = "what was asked";
  protos::ProposalResponsePayload response;
  response.set_proposal_hash(proposal_hash(payload.header().channel_header(), action_header, asked));
  response.set_extension(action.SerializeAsString());
  call(on_response, response);
  std::string response_bytes = response.SerializeAsString();
  call(on_response_bytes, response_bytes);

  std::vector<protos::Endorsement> endorsements;
  for (const crypto::SigningIdentity* one : endorsers) {
    protos::Endorsement& endorsement = endorsements.emplace_back();
    endorsement.set_endorser(one->serialized);
    endorsement.set_signature(*one->signer->sign(response_bytes + one->serialized));
    call(on_endorsement, endorsement);
  }
  call(on_endorsements, endorsements);
  protos::ChaincodeActionPayload action_payload;
  action_payload.set_chaincode_proposal_payload(asked);
  action_payload.mutable_action()->set_proposal_response_payload(response_bytes);
  for (const protos::Endorsement& one : endorsements) *action_payload.mutable_action()->add_endorsements() = one;
  protos::Transaction transaction;
  transaction.add_actions()->set_header(action_header);
  transaction.mutable_actions(0)->set_payload(action_payload.SerializeAsString());
  call(on_transaction, transaction);
  std::string data = transaction.SerializeAsString();
  call(on_data, data);
  payload.set_data(data);
  common::Envelope envelope;
  envelope.set_payload(payload.SerializeAsString());
  envelope.set_signature(*creator->signer->sign(envelope.payload()));
  std::string bytes = envelope.SerializeAsString();
  call(on_envelope, bytes);
  return bytes;
}

namespace {

void add_good(std::vector<Kind>& out, const Cast& cast, const KeyState& state, Random& random) {
  const auto key = [&random] { return "draft/free/" + std::to_string(random.next() % 20); };
  const auto found = [&state](const std::string& name) { return state.find({contract, "", name}); };
  out.push_back({"blind write by two peers", [=](Draft& d) { write(d, key()); }});
  out.push_back({"three peers", [=, &cast](Draft& d) {
                   write(d, key());
                   d.endorsers.push_back(&cast.peers[2]);
                 }});
  out.push_back({"peers that nobody has seen", [=, &cast](Draft& d) {
                   write(d, key());
                   d.endorsers = {&cast.new_peers[0], &cast.new_peers[1]};
                 }});
  out.push_back({"read and written", [=](Draft& d) {
                   const std::string name = key();
                   read(d, name, found(name));
                   write(d, name);
                 }});
  out.push_back({"reads alone", [=](Draft& d) {
                   const std::string name = key();
                   read(d, name, found(name));
                 }});
  out.push_back({"an absent key read as absent", [=](Draft& d) {
                   read(d, "draft/never", std::nullopt);
                   write(d, key());
                 }});
  out.push_back({"nothing read or written", [](Draft&) {}});
  out.push_back({"a key deleted", [=](Draft& d) {
                   d.set.add_writes()->set_key(key());
                   d.set.mutable_writes(0)->set_is_delete(true);
                 }});
  out.push_back({"an empty value", [=](Draft& d) { write(d, key(), ""); }});
  out.push_back({"a key written twice", [=](Draft& d) {
                   const std::string name = key();
                   write(d, name, "one");
                   write(d, name, "two");
                 }});
  out.push_back({"a key with its policy", [&random](Draft& d) {
                   const std::string name = "draft/own/" + std::to_string(random.next() % 20);
                   write(d, name);
                   set_policy(d, name, "Org1MSP");
                 }});
  out.push_back({"metadata of a key that is not there", [=](Draft& d) { set_policy(d, "draft/never", "Org1MSP"); }});
  out.push_back({"version 99 of the contract", [=](Draft& d) {
                   write(d, key());
                   d.action.mutable_chaincode_id()->set_version("99");
                 }});
  out.push_back({"status 500", [=](Draft& d) {
                   write(d, key());
                   d.action.mutable_response()->set_status(500);
                 }});
  out.push_back({"an event", [=](Draft& d) {
                   write(d, key());
                   set_event(d, contract, "another transaction");
                 }});
  out.push_back({"an action of another nonce", [=](Draft& d) {
                   write(d, key());
                   d.on_action_header = [](std::string& bytes) {
                     common::SignatureHeader header;
                     header.ParseFromString(bytes);
                     header.set_nonce("another nonce");
                     bytes = header.SerializeAsString();
                   };
                 }});
  out.push_back({"another namespace read", [=](Draft& d) {
                   write(d, key());
                   d.on_results = with_namespace("unheard", false);
                 }});
}

void add_ranges(std::vector<Kind>& out, const KeyState& state, Random& random) {
  const auto range = [&state](Draft& d, bool exhausted, int drop) {
    kvrwset::RangeQueryInfo& query = *d.set.add_range_queries_info();
    query.set_start_key("draft/range/");
    query.set_end_key("draft/range0");
    query.set_itr_exhausted(exhausted);
    std::vector<kvrwset::KVRead> reads;
    state.walk(contract, query.start_key(), [&](const std::string& key, Version version) {
      if (key >= query.end_key()) return false;
      kvrwset::KVRead one;
      one.set_key(key);
      one.mutable_version()->set_block_num(version.block);
      one.mutable_version()->set_tx_num(version.tx);
      reads.push_back(std::move(one));
      return true;
    });
    for (; drop > 0 && !reads.empty(); --drop) reads.pop_back();
    auto& raw = *query.mutable_raw_reads();
    for (const kvrwset::KVRead& one : reads) *raw.add_kv_reads() = one;
    if (!exhausted && !reads.empty()) query.set_end_key(reads.back().key());
  };
  out.push_back({"a key of the range written",
                 [&random](Draft& d) { write(d, "draft/range/" + std::to_string(random.next() % 9)); }});
  out.push_back({"a key of the range deleted", [&random](Draft& d) {
                   d.set.add_writes()->set_key("draft/range/" + std::to_string(random.next() % 9));
                   d.set.mutable_writes(0)->set_is_delete(true);
                 }});
  out.push_back({"a whole range read", [range](Draft& d) { range(d, true, 0); }});
  out.push_back({"a range read in part", [range](Draft& d) { range(d, false, 2); }});
  out.push_back({"a range without its last keys", [range](Draft& d) { range(d, true, 2); }});
}

void add_headers(std::vector<Kind>& out, Random& random) {
  const auto key = [&random] { return "draft/free/" + std::to_string(random.next() % 20); };
  const auto headers = [&](const std::string& name,
                           std::function<void(common::ChannelHeader&, common::SignatureHeader&)> bend) {
    out.push_back({name, [=](Draft& d) {
                     write(d, key());
                     d.on_headers = bend;
                   }});
  };
  headers("an epoch", [](auto& channel, auto&) { channel.set_epoch(1); });
  headers("another type", [](auto& channel, auto&) { channel.set_type(common::MESSAGE); });
  headers("a type that nobody knows", [](auto& channel, auto&) { channel.set_type(77); });
  headers("no nonce", [](auto& channel, auto& signature) {
    signature.clear_nonce();
    channel.set_tx_id(transaction_id(signature));
  });
  headers("an id of another", [](auto& channel, auto&) { channel.set_tx_id(std::string(64, 'a')); });
  headers("no id", [](auto& channel, auto&) { channel.clear_tx_id(); });
  headers("a nonce behind the id", [](auto&, auto& signature) { signature.set_nonce("later"); });
  const auto extension = [&](const std::string& name, std::function<void(Draft&)> bend) {
    out.push_back({name, [=](Draft& d) {
                     write(d, key());
                     bend(d);
                   }});
  };
  extension("a header extension that is none",
            [](Draft& d) { d.on_extension = [](std::string& bytes) { bytes = garbage; }; });
  extension("a header without contract", [](Draft& d) { d.extension.clear_chaincode_id(); });
  extension("a header with an empty contract", [](Draft& d) { d.extension.mutable_chaincode_id()->set_name(""); });
  extension("a header of another contract", [](Draft& d) { d.extension.mutable_chaincode_id()->set_name("other"); });
  extension("a contract that is not there", [](Draft& d) {
    d.extension.mutable_chaincode_id()->set_name("other");
    d.action.mutable_chaincode_id()->set_name("other");
  });
}

void add_layers(std::vector<Kind>& out, Random& random) {
  const auto add = [&](const std::string& name, std::function<void(Draft&)> bend) {
    out.push_back({name, [=, &random](Draft& d) {
                     write(d, "draft/free/" + std::to_string(random.next() % 20));
                     bend(d);
                   }});
  };
  add("data that is no transaction", [](Draft& d) { d.on_data = [](std::string& bytes) { bytes = garbage; }; });
  add("no action", [](Draft& d) { d.on_transaction = [](auto& tx) { tx.clear_actions(); }; });
  add("two actions", [](Draft& d) { d.on_transaction = [](auto& tx) { tx.add_actions()->CopyFrom(tx.actions(0)); }; });
  add("an action without header", [](Draft& d) { d.on_action_header = [](std::string& bytes) { bytes.clear(); }; });
  add("an action that is none",
      [](Draft& d) { d.on_transaction = [](auto& tx) { tx.mutable_actions(0)->set_payload(garbage); }; });
  add("another proposal's hash",
      [](Draft& d) { d.on_response = [](auto& response) { response.set_proposal_hash(std::string(32, 'h')); }; });
  add("a response that is none", [](Draft& d) { d.on_response_bytes = [](std::string& bytes) { bytes = garbage; }; });
  add("a response without result",
      [](Draft& d) { d.on_response = [](auto& response) { response.clear_extension(); }; });
  add("a result that is none",
      [](Draft& d) { d.on_response = [](auto& response) { response.set_extension(garbage); }; });
  add("reads and writes that are none", [](Draft& d) { d.on_results = [](std::string& bytes) { bytes = garbage; }; });
  add("a namespace's that are none", [](Draft& d) {
    d.on_results = [](std::string& bytes) {
      rwset::TxReadWriteSet all;
      all.ParseFromString(bytes);
      all.mutable_ns_rwset(0)->set_rwset(garbage);
      bytes = all.SerializeAsString();
    };
  });
  add("a result without contract", [](Draft& d) { d.action.clear_chaincode_id(); });
  add("a result of another contract", [](Draft& d) { d.action.mutable_chaincode_id()->set_name("other"); });
  add("a result of no version", [](Draft& d) { d.action.mutable_chaincode_id()->clear_version(); });
  add("an event that is none", [](Draft& d) { d.action.set_events(garbage); });
  add("an event of another contract", [](Draft& d) { set_event(d, "other", "transaction"); });
  add("a namespace twice", [](Draft& d) { d.on_results = with_namespace(contract, true); });
  add("a write to _lifecycle", [](Draft& d) { d.on_results = with_namespace("_lifecycle", true); });
  add("a write to a contract that is not there", [](Draft& d) { d.on_results = with_namespace("unheard", true); });
  // A write to a collection that nobody has defined is not among them: Fabric's peers of 2.5.0 end on it, and on each
  // attempt to start again.
}

void add_endorsements(std::vector<Kind>& out, const Cast& cast, Random& random) {
  const auto add = [&](const std::string& name, std::function<void(Draft&)> bend) {
    out.push_back({name, [=, &random](Draft& d) {
                     write(d, "draft/free/" + std::to_string(random.next() % 20));
                     bend(d);
                   }});
  };
  const auto by = [&](const std::string& name, std::vector<const crypto::SigningIdentity*> endorsers) {
    add(name, [endorsers](Draft& d) { d.endorsers = endorsers; });
  };
  by("no endorsement", {});
  by("one organisation alone", {&cast.peers[0]});
  by("one organisation's two peers", {&cast.peers[0], &cast.new_peers[0]});
  by("a client beside a peer", {&cast.peers[1], &cast.client});
  by("an administrator beside a peer", {&cast.peers[1], &cast.admin});
  by("a peer of an authority that is nobody's", {&cast.peers[1], &cast.nobodys});
  add("one peer twice", [&cast](Draft& d) { d.endorsers = {&cast.peers[0], &cast.peers[0]}; });
  add("one peer's certificate laid out twice", [&cast](Draft& d) {
    d.endorsers = {&cast.peers[0]};
    d.on_endorsements = [](auto& all) { all.push_back(all[0]); };
  });
  add("a worthless endorsement beside two good ones", [](Draft& d) {
    d.on_endorsements = [](auto& all) {
      all.insert(all.begin(), all[0]);
      all[0].set_signature("nothing");
    };
  });
  add("a signature of something else",
      [](Draft& d) { d.on_endorsements = [](auto& all) { all[0].set_signature(all[1].signature()); }; });
  add("a high S", [](Draft& d) { d.on_endorsement = raise_s; });
  add("a result that was changed behind the endorsement", [](Draft& d) {
    d.on_transaction = [](protos::Transaction& tx) {
      protos::ChaincodeActionPayload action;
      action.ParseFromString(tx.actions(0).payload());
      protos::ProposalResponsePayload response;
      response.ParseFromString(action.action().proposal_response_payload());
      protos::ChaincodeAction result;
      result.ParseFromString(response.extension());
      result.mutable_response()->set_message("changed");
      response.set_extension(result.SerializeAsString());
      action.mutable_action()->set_proposal_response_payload(response.SerializeAsString());
      tx.mutable_actions(0)->set_payload(action.SerializeAsString());
    };
  });
}

void add_policies(std::vector<Kind>& out, const Cast& cast, Random& random) {
  const auto own = [&](const std::string& name, std::vector<const crypto::SigningIdentity*> endorsers,
                       std::function<void(Draft&, const std::string&)> bend) {
    out.push_back({name, [=, &random](Draft& d) {
                     d.endorsers = endorsers;
                     bend(d, "draft/own/" + std::to_string(random.next() % 20));
                   }});
  };
  const auto plain = [](Draft& d, const std::string& key) { write(d, key); };
  own("a kept key by its owner", {&cast.peers[0]}, plain);
  own("a kept key by another", {&cast.peers[2]}, plain);
  own("a kept key by two others", {&cast.peers[1], &cast.peers[2]}, plain);
  own("a kept key deleted by another", {&cast.peers[1]}, [](Draft& d, const std::string& key) {
    d.set.add_writes()->set_key(key);
    d.set.mutable_writes(0)->set_is_delete(true);
  });
  own("a kept key deleted by its owner", {&cast.peers[0]}, [](Draft& d, const std::string& key) {
    d.set.add_writes()->set_key(key);
    d.set.mutable_writes(0)->set_is_delete(true);
  });
  own("its policy replaced by another", {&cast.peers[1]},
      [](Draft& d, const std::string& key) { set_policy(d, key, "Org2MSP"); });
  own("its policy replaced by its owner", {&cast.peers[0]},
      [](Draft& d, const std::string& key) { set_policy(d, key, "Org1MSP"); });
  own("its policy taken away by its owner", {&cast.peers[0]},
      [](Draft& d, const std::string& key) { set_policy(d, key, ""); });
  own("a kept key beside a free one, by its owner", {&cast.peers[0]}, [](Draft& d, const std::string& key) {
    write(d, key);
    write(d, "draft/free/0");
  });
  own("a kept key beside a free one, by two", {&cast.peers[0], &cast.peers[1]}, [](Draft& d, const std::string& key) {
    write(d, key);
    write(d, "draft/free/0");
  });
}

void add_stale(std::vector<Kind>& out, const KeyState& state, Random& random) {
  const auto stale = [&](const std::string& name,
                         std::function<std::optional<ChannelState::Key>(std::optional<ChannelState::Key>)> bend) {
    out.push_back({name, [=, &state, &random](Draft& d) {
                     const std::string key = "draft/free/" + std::to_string(random.next() % 20);
                     read(d, key, bend(state.find({contract, "", key})));
                     write(d, key);
                   }});
  };
  stale("a version that is not the newest", [](auto) { return ChannelState::Key{{0, 1}}; });
  stale("a version that never was", [](auto) { return ChannelState::Key{{1'000'000, 7}}; });
  stale("read as absent", [](auto) { return std::nullopt; });
}

}  // namespace

std::vector<Kind> kinds(const Cast& cast, const KeyState& state, Random& random) {
  std::vector<Kind> out;
  add_good(out, cast, state, random);
  add_ranges(out, state, random);
  add_headers(out, random);
  add_layers(out, random);
  add_endorsements(out, cast, random);
  add_policies(out, cast, random);
  add_stale(out, state, random);
  out.push_back({"ordered again", {}, true});
  for (Kind& kind : out) {
    for (const char* name : {"data that is no transaction", "no action", "an action that is none",
                             "a response that is none", "a result that is none"})
      kind.alone = kind.alone || kind.name == name;
  }
  return out;
}

}  // namespace ledgerline::fabric
