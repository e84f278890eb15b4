#include "chaincode/endorser/core/peer_snapshot.hpp"

#include <fmt/format.h>

#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "chaincode/node/core/tx/messages.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/channel_state.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::endorser {
namespace {

namespace file = peer_snapshot_file;

constexpr char format = 1;  // the first byte of each binary file
constexpr std::size_t hash_bytes = 32;
// Values of CouchDB are not always the bytes that were written: it keeps JSON as documents.
constexpr std::string_view database = "SimpleKeyValueDB";
constexpr std::string_view config_key = "CHANNEL_CONFIG_ENV_BYTES";  // in the namespace without a name

Error wrong(std::string_view name, std::string_view what) { return Error{fmt::format("{}: {}", name, what)}; }

/// Numbers as Go's encoding/binary has them (Uvarint), texts behind their length.
class GoReader : public ByteReader {
 public:
  using ByteReader::ByteReader;

  std::uint64_t number() {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      const std::string_view byte = read(1);
      const auto bits = byte.empty() ? std::uint8_t{0} : static_cast<std::uint8_t>(byte.front());
      value |= static_cast<std::uint64_t>(bits & 0x7fU) << shift;
      if (bits < 0x80 && (shift < 63 || bits <= 1)) return value;
    }
    expect(false);
    return 0;
  }
  std::string_view text() { return read(number()); }
};

/// Behind the byte of the format.
Result<GoReader> behind_format(std::string_view name, std::string_view bytes) {
  if (bytes.empty()) return wrong(name, "it is empty");
  if (bytes.front() != format)
    return wrong(name,
                 fmt::format("its format is {}, where {} is read: of another version of Fabric",
                             static_cast<int>(static_cast<std::uint8_t>(bytes.front())), static_cast<int>(format)));
  return GoReader(bytes.substr(1));
}

std::string text_in(const nlohmann::json& object, std::string_view key) {
  const auto found = object.find(std::string(key));
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

/// Checks what the snapshot says of itself; what it says of the other files.
Result<nlohmann::json> read_description(const PeerSnapshotFiles& files, std::string_view hash) {
  const auto parse = [](const std::string& text) { return nlohmann::json::parse(text, nullptr, false); };
  const nlohmann::json beside = parse(files.description_hash);
  if (!beside.is_object()) return wrong(file::description_hash, "it is no JSON object");
  const std::string own = crypto::hex(crypto::sha256(files.description));
  if (text_in(beside, "snapshot_hash") != own)
    return wrong(file::description, fmt::format("its SHA-256 is not the snapshot_hash of {}", file::description_hash));
  if (!hash.empty() && hash != own)
    return wrong(file::description,
                 fmt::format("its SHA-256 is {}, not first_state_hash: it is another snapshot", own));
  nlohmann::json reported = parse(files.description);
  if (!reported.is_object()) return wrong(file::description, "it is no JSON object");
  return reported;
}

Status check_hashes(const nlohmann::json& reported, const PeerSnapshotFiles& files) {
  const auto hashes = reported.find("snapshot_files_raw_hashes");
  if (hashes == reported.end() || !hashes->is_object())
    return wrong(file::description, "it has no snapshot_files_raw_hashes");
  for (const auto& [name, bytes] : {std::pair{file::states, &files.states},
                                    {file::states_counts, &files.states_counts},
                                    {file::ids, &files.ids},
                                    {file::ids_count, &files.ids_count}}) {
    if (text_in(*hashes, name) != crypto::hex(crypto::sha256(*bytes)))
      return wrong(name, fmt::format("its SHA-256 is not the one that {} names: it is damaged, or was changed",
                                     file::description));
  }
  return done;
}

Result<node::ChainEnd> read_end(const nlohmann::json& reported, const std::string& channel) {
  const std::string its = text_in(reported, "channel_name"), kept_in = text_in(reported, "state_db_type");
  if (its != channel)
    return wrong(file::description, fmt::format("it is of channel {}, not of {}", printable(its), channel));
  if (kept_in != database)
    return wrong(file::description, fmt::format("the peer's state_db_type is {}, where {} is read (LevelDB)",
                                                printable(kept_in), database));
  const auto number = reported.find("last_block_number");
  auto hash = crypto::unhex(text_in(reported, "last_block_hash"));
  if (number == reported.end() || !number->is_number_unsigned() || !hash || hash->size() != hash_bytes ||
      number->get<std::uint64_t>() == UINT64_MAX)
    return wrong(file::description, "it has no last_block_number, or no last_block_hash");
  return node::ChainEnd{number->get<std::uint64_t>() + 1, std::move(*hash)};
}

/// Fabric's SnapshotRecord: bytes in the fields 1 to 4.
struct Record {
  std::string_view key, value, metadata, version;
};
std::optional<Record> record_of(std::string_view bytes) {
  constexpr std::uint64_t bytes_follow = 2;  // the wire type
  Record out;
  const std::array<std::string_view*, 4> fields{&out.key, &out.value, &out.metadata, &out.version};
  GoReader from(bytes);
  for (std::uint64_t before = 0; !from.at_end();) {
    const std::uint64_t tag = from.number(), field = tag >> 3;
    if ((tag & 7) != bytes_follow || field <= before || field > fields.size()) return std::nullopt;
    *fields[field - 1] = from.text();
    if (!from.is_whole()) return std::nullopt;
    before = field;
  }
  return out;
}

/// Two numbers, each behind how many bytes it has, the highest first.
std::optional<node::Version> version_of(std::string_view bytes) {
  std::array<std::uint64_t, 2> numbers{};
  for (std::uint64_t& number : numbers) {
    if (bytes.empty()) return std::nullopt;
    const auto size = static_cast<std::uint8_t>(bytes.front());
    if (size > 8 || size >= bytes.size()) return std::nullopt;
    for (const char byte : bytes.substr(1, size)) number = number << 8 | static_cast<std::uint8_t>(byte);
    bytes.remove_prefix(1U + size);
  }
  if (!bytes.empty()) return std::nullopt;
  return node::Version{numbers[0], numbers[1]};
}

/// Its own policy among what a key has beside its value; empty: none. nullopt: it does not parse.
std::optional<std::string> policy_of(std::string_view metadata) {
  kvrwset::KVMetadataWrite entries;
  if (metadata.size() > INT32_MAX || !entries.ParseFromArray(metadata.data(), static_cast<int>(metadata.size())))
    return std::nullopt;
  std::string policy;
  for (const kvrwset::KVMetadataEntry& entry : entries.entries()) {
    if (entry.name() == fabric::validation_parameter) policy = entry.value();
  }
  return policy;
}

/// Namespaces in the order of the states, with how many each has.
Result<std::vector<std::pair<std::string_view, std::uint64_t>>> read_counts(std::string_view bytes) {
  auto from = behind_format(file::states_counts, bytes);
  if (!from) return from.error();
  const auto damaged = wrong(file::states_counts, "it is not whole");
  const std::uint64_t count = from->number();
  if (count > from->left() / 2) return damaged;
  std::vector<std::pair<std::string_view, std::uint64_t>> rows;
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::string_view name = from->text();
    if (!rows.empty() && name <= rows.back().first) return damaged;
    rows.emplace_back(name, from->number());
  }
  if (!from->is_whole() || !from->at_end()) return damaged;
  return rows;
}

/// Adds a key to those of its namespace, which come in their order.
Status add(node::State::Values& values, const Record& record, std::uint64_t height) {
  const auto version = version_of(record.version);
  auto policy = policy_of(record.metadata);
  const bool in_order = values.empty() || values.rbegin()->first < record.key;
  if (record.key.empty() || record.value.empty() || !version || version->block >= height || !policy || !in_order)
    return wrong(file::states, fmt::format("the record of key {} is damaged", printable(record.key)));
  values.emplace_hint(values.end(), std::string(record.key),
                      node::State::Value{std::string(record.value), *version, std::move(*policy)});
  return done;
}

Status read_states(const PeerSnapshotFiles& files, const std::string& contract, PeerSnapshot& out,
                   node::State::Parts& parts) {
  const auto rows = read_counts(files.states_counts);
  if (!rows) return rows.error();
  auto from = behind_format(file::states, files.states);
  if (!from) return from.error();
  const auto damaged = wrong(file::states, "it is not whole");
  node::State::Parts lifecycle;
  node::State::Values channel;
  for (const auto& [name, count] : *rows) {
    node::State::Values* const values = name == contract                 ? &parts.values
                                        : name == fabric::lifecycle_name ? &lifecycle.values
                                        : name.empty()                   ? &channel
                                                                         : nullptr;
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::string_view bytes = from->text();
      if (!from->is_whole()) return damaged;
      if (values == nullptr) continue;
      const auto record = record_of(bytes);
      if (!record) return wrong(file::states, fmt::format("a record of {} is damaged", printable(name)));
      if (Status added = add(*values, *record, out.end.height); !added) return added;
    }
  }
  if (!from->at_end()) return damaged;
  const auto config = channel.find(std::string(config_key));
  if (config == channel.end()) return wrong(file::states, "it has no configuration of the channel");
  out.config = std::move(config->second.bytes);
  out.config_block = config->second.version.block;
  out.lifecycle = node::State(std::move(lifecycle));
  return done;
}

Status read_ids(const PeerSnapshotFiles& files, std::uint64_t last, node::State::Parts& parts) {
  auto counts = behind_format(file::ids_count, files.ids_count);
  if (!counts) return counts.error();
  const std::uint64_t count = counts->number();
  if (!counts->is_whole() || !counts->at_end()) return wrong(file::ids_count, "it is not whole");
  auto from = behind_format(file::ids, files.ids);
  if (!from) return from.error();
  const auto damaged = wrong(file::ids, "it is not whole");
  std::string_view before;
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::string_view id = from->text();
    const bool in_order = i == 0 || std::pair(before.size(), before) < std::pair(id.size(), id);
    if (!from->is_whole() || !in_order) return damaged;
    if (id.size() == fabric::id_digits) parts.txs.emplace(id, node::State::Tx{last, protos::NOT_VALIDATED});
    before = id;
  }
  if (!from->at_end()) return damaged;
  return done;
}

/// common.ConfigEnvelope of a block that configures its channel.
std::string config_in(const common::Block& block) {
  common::Envelope envelope;
  common::Payload payload;
  if (!fabric::is_config(block) || !envelope.ParseFromString(block.data().data(0)) ||
      !payload.ParseFromString(envelope.payload()))
    return {};
  return std::move(*payload.mutable_data());
}

/// A block of the chain whose data match its header.
Result<common::Block> fetch_whole(std::uint64_t number, const fabric::BlockValidator::Fetch& fetch) {
  auto block = fetch(number);
  if (!block) return block;
  if (const auto decoded = fabric::decode_block(block->SerializeAsString()); !decoded) return decoded.error();
  return block;
}

}  // namespace

Result<PeerSnapshot> read_peer_snapshot(const PeerSnapshotFiles& files, const fabric::ChannelAndContract& where,
                                        std::string_view hash) {
  const auto reported = read_description(files, hash);
  if (!reported) return reported.error();
  if (Status same = check_hashes(*reported, files); !same) return same.error();
  auto end = read_end(*reported, where.channel);
  if (!end) return end.error();
  PeerSnapshot out;
  out.end = std::move(*end);
  node::State::Parts parts;
  parts.history_since = out.end.height;
  if (Status read = read_states(files, where.contract, out, parts); !read) return read.error();
  if (Status read = read_ids(files, out.end.height - 1, parts); !read) return read.error();
  out.contract = node::State(std::move(parts));
  return out;
}

Result<std::string> verify_snapshot(const PeerSnapshot& reported, fabric::BlockValidator& validator,
                                    const fabric::BlockValidator::Fetch& fetch) {
  const std::uint64_t last = reported.end.height - 1;
  if (last < validator.config_block_number())
    return Error{fmt::format("its newest block, {}, is older than config_block, which is block {}", last,
                             validator.config_block_number())};
  const auto newest = fetch_whole(last, fetch);
  if (!newest) return newest.error();
  if (newest->header().number() != last || fabric::header_hash(newest->header()) != reported.end.hash)
    return Error{fmt::format("the peer has another block {} than the snapshot's newest: it is of another chain", last)};
  if (Status known = validator.catch_up(*newest, fetch); !known) return known.error();
  if (Status valid = validator.validate(*newest); !valid) return valid.error();
  const auto config = fetch_whole(validator.config_block_number(), fetch);
  if (!config) return config.error();
  if (Status valid = validator.validate(*config); !valid) return valid.error();
  if (reported.config_block != validator.config_block_number() || reported.config != config_in(*config))
    return Error{fmt::format("its configuration, of block {}, is not the channel's, of block {}", reported.config_block,
                             validator.config_block_number())};
  return config->SerializeAsString();
}

}  // namespace ledgerline::endorser
