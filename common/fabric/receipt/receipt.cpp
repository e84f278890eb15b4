#include "common/fabric/receipt/receipt.hpp"

#include <fmt/format.h>

namespace ledgerline::fabric {
namespace {

constexpr std::string_view first_line = "ledgerline receipt 1\n";
constexpr std::size_t length_bytes = 4;  // big-endian
constexpr std::size_t number_bytes = 8;

class Writer {
 public:
  void number(std::uint64_t value, std::size_t bytes) {
    for (std::size_t i = bytes; i > 0; --i) out_.push_back(static_cast<char>(value >> (8 * (i - 1)) & 0xff));
  }
  void text(std::string_view value) {
    number(value.size(), length_bytes);
    out_ += value;
  }
  void signature(const Receipt::Signature& one) {
    text(one.signer);
    text(one.signature);
  }
  std::string take() { return std::move(out_); }

 private:
  std::string out_{first_line};
};

/// Ends quietly at the first value that is not there; `good` says so.
class Reader {
 public:
  explicit Reader(std::string_view rest) : rest_(rest) {}

  std::uint64_t number(std::size_t bytes) {
    if (rest_.size() < bytes) return fail();
    std::uint64_t value = 0;
    for (const char c : rest_.substr(0, bytes)) value = value << 8 | static_cast<unsigned char>(c);
    rest_.remove_prefix(bytes);
    return value;
  }
  std::string text() {
    const std::uint64_t length = number(length_bytes);
    if (length > rest_.size()) fail();
    if (!good_) return {};
    std::string value(rest_.substr(0, length));
    rest_.remove_prefix(length);
    return value;
  }
  Receipt::Signature signature() {
    std::string signer = text();
    return {std::move(signer), text()};
  }
  /// So many values follow; where they do not, reading them ends at the first that is not there.
  std::uint64_t count() { return number(length_bytes); }
  bool ended() const { return good_ && rest_.empty(); }
  bool good() const { return good_; }

 private:
  std::uint64_t fail() {
    good_ = false;
    rest_ = {};
    return 0;
  }
  std::string_view rest_;
  bool good_ = true;
};

}  // namespace

std::string receipt_bytes(const Receipt& receipt) {
  Writer out;
  out.text(receipt.channel);
  out.text(receipt.tx_id);
  out.number(receipt.block.number, number_bytes);
  out.text(receipt.block.previous_hash);
  out.text(receipt.block.data_hash);
  out.number(receipt.block.data.size(), length_bytes);
  for (const std::string& envelope : receipt.block.data) out.text(envelope);
  out.text(receipt.block.orderers_value);
  out.number(receipt.block.orderers.size(), length_bytes);
  for (const Receipt::Signature& one : receipt.block.orderers) out.signature(one);
  out.text(receipt.question);
  out.number(receipt.answers.size(), length_bytes);
  for (const Receipt::Answer& answer : receipt.answers) {
    out.text(answer.payload);
    out.signature(answer.endorsement);
  }
  return out.take();
}

Result<Receipt> read_receipt(std::string_view bytes) {
  if (!bytes.starts_with(first_line)) return Error{"it is no receipt, or of another version than 1"};
  if (bytes.size() > max_receipt_bytes)
    return Error{fmt::format("it has {} bytes; a receipt has {} at most", bytes.size(), max_receipt_bytes)};
  Reader in(bytes.substr(first_line.size()));
  Receipt receipt;
  receipt.channel = in.text();
  receipt.tx_id = in.text();
  receipt.block.number = in.number(number_bytes);
  receipt.block.previous_hash = in.text();
  receipt.block.data_hash = in.text();
  for (std::uint64_t left = in.count(); left > 0 && in.good(); --left) receipt.block.data.push_back(in.text());
  receipt.block.orderers_value = in.text();
  for (std::uint64_t left = in.count(); left > 0 && in.good(); --left) receipt.block.orderers.push_back(in.signature());
  receipt.question = in.text();
  for (std::uint64_t left = in.count(); left > 0 && in.good(); --left) {
    std::string payload = in.text();
    receipt.answers.push_back({std::move(payload), in.signature()});
  }
  if (!in.ended()) return Error{in.good() ? "something follows behind its end" : "it is cut off or damaged"};
  return receipt;
}

}  // namespace ledgerline::fabric
