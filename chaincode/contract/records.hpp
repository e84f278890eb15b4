#pragma once
#include <algorithm>
#include <map>

#include "chaincode/contract/contract_common.hpp"
#include "common/msg/contract.hpp"

/// The contract's own records: control/<drone>, stop/<drone>/<stopper>, stop/<drone>/<stopper>/lifted,
/// stop/<drone>/<claimant>/claim, grant/<drone>, request/<drone>, request/<drone>/claim, owner/<drone>, drones/<MSP
/// id>, role/<MSP id>/<hex digit>, pilot/<owner MSP>/<commander>, and the two that the hot path reads instead of every
/// drone's control record, lease/<owner MSP>/<commander>/<epoch> and host/<owner>. Each is kept as an asset, so that
/// `get` serves it.
///
/// A record has an endorsing MSP: the organisation whose peer alone endorses its changes, by the key's own policy. The
/// policy is set once, by the call that makes the record, and with it Stored.version. A record of an older version gets
/// both when a control call next touches it.
namespace ledgerline::chaincode {

/// The record that is stored under a key.
template <typename Message>
Result<Message> parse_record(const std::string& key, const Stored& stored) {
  Message message;
  if (stored.assets_size() != 1 || !message.ParseFromString(stored.assets(0).msg_data())) {
    return Error{"the record " + key + " is damaged"};
  }
  return message;
}
template <typename Message>
Result<Message> parse_record(const KeyValue& entry) {
  Stored stored;
  if (!stored.ParseFromString(entry.value)) return Error{"the record " + entry.key + " is damaged"};
  return parse_record<Message>(entry.key, stored);
}

template <typename Message>
struct Versioned {
  Message message;
  std::uint32_t version = 0;  ///< Stored.version
};
/// nullopt: there is none.
template <typename Message>
Result<std::optional<Versioned<Message>>> read_versioned(Stub& stub, const std::string& key) {
  const auto stored = read_stored(stub, key);
  if (!stored) return stored.error();
  if (!*stored) return std::optional<Versioned<Message>>{};
  auto message = parse_record<Message>(key, **stored);
  if (!message) return message.error();
  return std::optional(Versioned<Message>{std::move(*message), (*stored)->version()});
}
template <typename Message>
Result<std::optional<Message>> read_record(Stub& stub, const std::string& key) {
  auto record = read_versioned<Message>(stub, key);
  if (!record) return record.error();
  if (!*record) return std::optional<Message>{};
  return std::optional(std::move((*record)->message));
}
/// As it is: no policy is set. `version`: the one that it has.
Status write_record(Stub& stub, const std::string& key, const google::protobuf::Message& message,
                    std::uint32_t version = 0);
/// Makes a record, or renews one of an older version: with a policy of `endorsing_msp` alone.
Status make_record(Stub& stub, const std::string& key, const google::protobuf::Message& message,
                   const std::string& endorsing_msp);

/// Records of one kind that one call reads and changes: each is read once and, when it was changed, written once (a
/// call does not see what it writes). One that is not there is empty. With an endorsing MSP, one that is new or of an
/// older version gets its policy; the hot path names none, and makes none.
template <typename Message>
class Records {
 public:
  explicit Records(Stub& stub) : stub_(stub) {}

  Result<Message*> at(const std::string& key, const std::string& endorsing_msp = {}) {
    auto known = records_.find(key);
    if (known == records_.end()) {
      auto record = read_versioned<Message>(stub_, key);
      if (!record) return record.error();
      Entry entry{.there = record->has_value(), .endorsing_msp = endorsing_msp};
      if (*record) entry.version = (*record)->version;
      if (*record) entry.now = std::move((*record)->message);
      entry.before = entry.now.SerializeAsString();
      known = records_.emplace(key, std::move(entry)).first;
    }
    return &known->second.now;
  }
  /// Of one that at() has given.
  bool was_there(const std::string& key) const { return records_.at(key).there; }
  /// Likewise: it has to be renewed.
  bool is_old(const std::string& key) const {
    return was_there(key) && records_.at(key).version < contract::record_version;
  }
  Status write() {
    for (const auto& [key, entry] : records_) {
      const bool old = !entry.endorsing_msp.empty() && is_old(key);
      if (entry.now.SerializeAsString() == entry.before && !old) continue;
      const bool make = !entry.endorsing_msp.empty() && (old || !entry.there);
      Status status = make ? make_record(stub_, key, entry.now, entry.endorsing_msp)
                           : write_record(stub_, key, entry.now, entry.version);
      if (!status) return status;
    }
    return done;
  }

 private:
  struct Entry {
    Message now{};
    std::string before{};
    bool there = false;
    std::uint32_t version = 0;
    std::string endorsing_msp;
  };
  Stub& stub_;
  std::map<std::string, Entry> records_;
};

/// Lists in records are sets, in order.
using Names = google::protobuf::RepeatedPtrField<std::string>;
inline bool contains(const Names& names, const std::string& name) {
  return std::binary_search(names.begin(), names.end(), name);
}
void insert(Names& names, const std::string& name);
void erase(Names& names, const std::string& name);

/// Adds to a control record what has keys of its own: the drone's grants, the stops that stand and how often stops were
/// cleared, who is revoked and who requests it. Stops come from a range, so a transaction that writes after reading
/// them loses to a stop that came between. The stop reads nothing of this and loses to nobody. `claims`: gets who has
/// claimed the drone, which is in the same range.
Status complete(Stub& stub, Control& control, std::vector<Identity>* claims = nullptr);
struct ControlState : Versioned<Control> {
  std::vector<Identity> claims;  ///< of those who have claimed the drone for its organisation
};
/// A complete one; nullopt: not enrolled. Its version is that of the drone's owner, grant and request records, too.
Result<std::optional<ControlState>> read_control(Stub& stub, const std::string& drone);
/// A control record as it is stored: without what complete() adds.
Control stored_part(const Control& control);
Status write_stop(Stub& stub, const Stop& stop);
/// stop/<drone>/<claimant>/claim. `stands`: or it is over.
Status write_claim(Stub& stub, const std::string& drone, const Identity& claimant, bool stands);
/// How often the stopper's stops of this drone were cleared.
Result<std::uint64_t> read_clears(Stub& stub, const std::string& drone, const crypto::IdentityName& stopper);
Status write_clears(Stub& stub, const std::string& drone, const StopClears& clears);
/// owner/<drone>.
Status make_owner(Stub& stub, const std::string& drone, const std::string& msp_id);
Result<Role> read_role(Stub& stub, const crypto::IdentityName& who);
/// ROLE_NONE leaves it as it is, and only makes the organisation's tables where they are not there. An error: there is
/// no place for one more.
Status write_role(Stub& stub, const crypto::IdentityName& who, Role role);

}  // namespace ledgerline::chaincode
