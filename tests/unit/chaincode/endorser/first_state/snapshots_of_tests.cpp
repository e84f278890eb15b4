#include "tests/unit/chaincode/endorser/first_state/snapshots_of_tests.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/channel_state.hpp"

namespace ledgerline::endorser {
namespace {

const std::string format(1, '\x01');

std::string with_length(std::uint64_t number) {
  std::string bytes;
  for (; number != 0; number >>= 8) bytes.insert(bytes.begin(), static_cast<char>(number & 255));
  return static_cast<char>(bytes.size()) + bytes;
}

std::string field(char number, std::string_view bytes) {
  return bytes.empty() ? "" : static_cast<char>(number << 3 | 2) + go_text(bytes);
}

Namespace keys_of(const std::string& name, const node::State& state) {
  Namespace out{name, {}};
  for (const auto& [key, value] : state.values()) out.records.push_back(state_record(key, value));
  return out;
}

}  // namespace

std::string go_number(std::uint64_t value) {
  std::string bytes;
  for (; value >= 0x80; value >>= 7) bytes.push_back(static_cast<char>((value & 0x7f) | 0x80));
  return bytes + static_cast<char>(value);
}

std::string go_text(std::string_view bytes) { return go_number(bytes.size()) + std::string(bytes); }

std::string state_record(std::string_view key, const node::State::Value& value) {
  kvrwset::KVMetadataWrite metadata;
  if (!value.policy.empty()) {
    metadata.add_entries()->set_name(fabric::validation_parameter);
    metadata.mutable_entries(0)->set_value(value.policy);
  }
  return go_text(field(1, key) + field(2, value.bytes) + field(3, metadata.SerializeAsString()) +
                 field(4, with_length(value.version.block) + with_length(value.version.tx)));
}

void put_states(PeerSnapshotFiles& files, const std::vector<Namespace>& namespaces) {
  files.states = format;
  files.states_counts = format + go_number(namespaces.size());
  for (const Namespace& one : namespaces) {
    files.states_counts += go_text(one.name) + go_number(one.records.size());
    for (const std::string& record : one.records) files.states += record;
  }
}

std::vector<Namespace> namespaces_of(const Snapshot& known) {
  common::Block block;
  common::Envelope envelope;
  common::Payload payload;
  block.ParseFromString(known.config_block);
  envelope.ParseFromString(block.data().data(0));
  payload.ParseFromString(envelope.payload());
  std::vector<Namespace> all{
      {"", {state_record("CHANNEL_CONFIG_ENV_BYTES", {payload.data(), {block.header().number(), 0}})}},
      keys_of("_lifecycle", known.lifecycle),
      {"asset", {state_record("a", {"1", {0, 0}}), state_record("b", {"2", {0, 70'000}})}},
      keys_of("ledgerline", known.contract),
      {"zebra", {state_record("a", {std::string(300, 'z'), {0, 1}})}}};
  std::erase_if(all, [](const Namespace& one) { return one.records.empty(); });
  return all;
}

void put_ids(PeerSnapshotFiles& files, const node::State& contract) {
  std::vector<std::string> ids{""};  // a configuration's
  for (const auto& [id, tx] : contract.parts().txs) ids.push_back(id);
  std::sort(ids.begin(), ids.end());
  files.ids = format;
  for (const std::string& id : ids) files.ids += go_text(id);
  files.ids_count = format + go_number(ids.size());
}

void seal(PeerSnapshotFiles& files, const node::ChainEnd& end, const std::string& channel,
          const std::string& database) {
  const auto hash = [](const std::string& bytes) { return crypto::hex(crypto::sha256(bytes)); };
  files.description = nlohmann::json{{"channel_name", channel},
                                     {"last_block_number", end.height - 1},
                                     {"last_block_hash", crypto::hex(end.hash)},
                                     {"previous_block_hash", std::string(64, '0')},
                                     {"state_db_type", database},
                                     {"snapshot_files_raw_hashes",
                                      {{"public_state.data", hash(files.states)},
                                       {"public_state.metadata", hash(files.states_counts)},
                                       {"txids.data", hash(files.ids)},
                                       {"txids.metadata", hash(files.ids_count)},
                                       {"private_state_hashes.data", std::string(64, '0')}}}}
                          .dump(4);
  files.description_hash =
      nlohmann::json{{"snapshot_hash", hash(files.description)}, {"last_block_commit_hash", ""}}.dump(4);
}

PeerSnapshotFiles snapshot_of(const Snapshot& known) {
  PeerSnapshotFiles files;
  put_states(files, namespaces_of(known));
  put_ids(files, known.contract);
  seal(files, known.end);
  return files;
}

}  // namespace ledgerline::endorser
