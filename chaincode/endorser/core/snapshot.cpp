#include "chaincode/endorser/core/endorser_core.hpp"

#include <utility>

#include "common/base/text.hpp"

namespace ledgerline::endorser {
namespace {

constexpr std::string_view kind = "ledgerline endorser 2\n";
constexpr std::string_view kind_of_before = "ledgerline endorser 1\n";  // always of the whole chain

class Writer {
 public:
  void number(std::uint64_t value) {
    char bytes[8];
    for (int i = 0; i < 8; ++i) bytes[i] = static_cast<char>(value >> (8 * i));
    out.append(bytes, sizeof bytes);
  }
  void text(std::string_view value) {
    number(value.size());
    out += value;
  }
  void version(node::Version value) {
    number(value.block);
    number(value.tx);
  }
  std::string out{kind};
};

class Reader : public ByteReader {
 public:
  using ByteReader::ByteReader;

  std::uint64_t number() {
    const std::string_view bytes = read(8);
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i)
      value |= static_cast<std::uint64_t>(static_cast<unsigned char>(bytes[i])) << (8 * i);
    return value;
  }
  std::string text() { return std::string(read(number())); }
  node::Version version() {
    const std::uint64_t block = number();
    return {block, number()};
  }
  /// Of entries that have at least so many bytes each.
  std::uint64_t count(std::size_t min_bytes) {
    const std::uint64_t value = number();
    expect(value <= left() / min_bytes);
    return is_whole() ? value : 0;
  }
};

void write(Writer& to, const node::State& state) {
  const node::State::Parts& parts = state.parts();
  to.number(parts.values.size());
  for (const auto& [key, value] : parts.values) {
    to.text(key);
    to.text(value.bytes);
    to.version(value.version);
    to.text(value.policy);
    to.text(value.writer);
  }
  to.number(parts.history.size());
  for (const auto& [key, versions] : parts.history) {
    to.text(key);
    to.number(versions.size());
    for (const node::Version version : versions) to.version(version);
  }
  to.number(parts.txs.size());
  for (const auto& [id, tx] : parts.txs) {
    to.text(id);
    to.number(tx.block);
    to.number(static_cast<std::uint64_t>(tx.code));
  }
}

node::State::Parts read_state(Reader& from) {
  node::State::Parts parts;
  for (std::uint64_t left = from.count(48); left > 0 && from.is_whole(); --left) {
    std::string key = from.text();
    node::State::Value value;
    value.bytes = from.text();
    value.version = from.version();
    value.policy = from.text();
    value.writer = from.text();
    from.expect(parts.values.empty() || parts.values.rbegin()->first < key);
    parts.values.emplace_hint(parts.values.end(), std::move(key), std::move(value));
  }
  for (std::uint64_t left = from.count(16); left > 0 && from.is_whole(); --left) {
    std::string key = from.text();
    std::vector<node::Version> versions;
    for (std::uint64_t more = from.count(16); more > 0 && from.is_whole(); --more) versions.push_back(from.version());
    from.expect(parts.history.empty() || parts.history.rbegin()->first < key);
    parts.history.emplace_hint(parts.history.end(), std::move(key), std::move(versions));
  }
  for (std::uint64_t left = from.count(24); left > 0 && from.is_whole(); --left) {
    std::string id = from.text();
    const std::uint64_t block = from.number(), code = from.number();
    from.expect(code < 256 && parts.txs.emplace(std::move(id), node::State::Tx{block, static_cast<int>(code)}).second);
  }
  return parts;
}

}  // namespace

std::string to_bytes(const node::ChainEnd& end, std::string_view config_block, const node::State& contract,
                     const node::State& lifecycle) {
  Writer to;
  to.number(end.height);
  to.text(end.hash);
  to.text(config_block);
  write(to, contract);
  write(to, lifecycle);
  to.number(contract.parts().history_since);
  return std::move(to.out);
}

Result<Snapshot> read_snapshot(std::string_view bytes) {
  const bool of_before = bytes.starts_with(kind_of_before);
  if (!of_before && !bytes.starts_with(kind)) return Error{"it is no endorser's state, or of another version"};
  Reader from(bytes.substr(kind.size()));
  Snapshot out;
  out.end.height = from.number();
  out.end.hash = from.text();
  out.config_block = from.text();
  node::State::Parts contract = read_state(from);
  out.lifecycle = node::State(read_state(from));
  if (!of_before) contract.history_since = from.number();
  from.expect(contract.history_since <= out.end.height);
  out.contract = node::State(std::move(contract));
  if (!from.is_whole() || !from.at_end() || out.end.height == 0) return Error{"an endorser's state is not whole"};
  return out;
}

}  // namespace ledgerline::endorser
