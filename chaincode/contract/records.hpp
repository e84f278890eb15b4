#pragma once
#include <algorithm>
#include <map>

#include "chaincode/contract/contract_common.hpp"

/// The contract's own records: control/<drone>, stop/<drone>/<stopper>, grant/<drone>, request/<drone>, owner/<drone>, drones/<MSP id>,
/// role/<identity>, and the two that the hot path reads instead of every drone's control record,
/// lease/<holder>/<epoch> and host/<owner>. Each is kept as an asset, so that `get` serves it.
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

/// nullopt: there is none.
template <typename Message>
Result<std::optional<Message>> read_record(Stub& stub, const std::string& key) {
  const auto stored = read_stored(stub, key);
  if (!stored) return stored.error();
  if (!*stored) return std::optional<Message>{};
  auto message = parse_record<Message>(key, **stored);
  if (!message) return message.error();
  return std::optional(std::move(*message));
}
Status write_record(Stub& stub, const std::string& key, const google::protobuf::Message& message);

/// Records of one kind that one call reads and changes: each is read once and, when it was changed, written once (a
/// call does not see what it writes). One that is not there is empty.
template <typename Message>
class Records {
 public:
  explicit Records(Stub& stub) : stub_(stub) {}

  Result<Message*> at(const std::string& key) {
    auto known = records_.find(key);
    if (known == records_.end()) {
      auto record = read_record<Message>(stub_, key);
      if (!record) return record.error();
      Message message = std::move(*record).value_or(Message{});
      known = records_.emplace(key, Entry{message, message.SerializeAsString()}).first;
    }
    return &known->second.now;
  }
  Status write() {
    for (const auto& [key, entry] : records_) {
      if (entry.now.SerializeAsString() == entry.before) continue;
      if (Status status = write_record(stub_, key, entry.now); !status) return status;
    }
    return done;
  }

 private:
  struct Entry {
    Message now;
    std::string before;
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

/// Adds to a control record what has keys of its own: the drone's grants, the stops that stand, who is revoked and who requests it. Stops
/// come from a range, so whoever writes after reading them loses to a stop that came between; the stop, which reads
/// nothing of this, loses to nobody.
Status complete(Stub& stub, Control& control);
/// A complete one; nullopt: not enrolled.
Result<std::optional<Control>> read_control(Stub& stub, const std::string& drone);
/// A control record as it is stored: without what complete() adds.
Control stored_part(const Control& control);
Status write_stop(Stub& stub, const Stop& stop);
Result<Role> read_role(Stub& stub, const crypto::IdentityName& who);

}  // namespace ledgerline::chaincode
