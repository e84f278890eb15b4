#include "common/fabric/blocks/checkpoint.hpp"

#include <fmt/format.h>
#include <pthread.h>

#include <charconv>
#include <chrono>
#include <filesystem>
#include <utility>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/envelope.hpp"

namespace ledgerline::fabric {
namespace {

constexpr std::string_view first_line = "ledgerline checkpoint 1\n";
constexpr std::string_view sum_word = "\nsum ";
constexpr std::size_t hash_bytes = 32;

/// Takes "WORD VALUE\n" off the front.
std::optional<std::string_view> take_line(std::string_view& text, std::string_view word) {
  const auto end = text.find('\n');
  if (end == std::string_view::npos || !text.starts_with(word) || end < word.size()) return std::nullopt;
  const std::string_view value = text.substr(word.size(), end - word.size());
  text.remove_prefix(end + 1);
  return value;
}

std::optional<std::uint64_t> number_of(std::optional<std::string_view> text) {
  std::uint64_t out = 0;
  if (!text || text->empty()) return std::nullopt;
  const char* const end = text->data() + text->size();
  const auto [at, error] = std::from_chars(text->data(), end, out);
  return error == std::errc() && at == end ? std::optional(out) : std::nullopt;
}

std::optional<std::string> hash_of(std::optional<std::string_view> hex) {
  return hex && hex->size() == 2 * hash_bytes ? crypto::unhex(*hex) : std::nullopt;
}

}  // namespace

std::string to_text(const Checkpoint& checkpoint) {
  std::string text = fmt::format("{}channel {}\nblock {}\nhash {}\nrecords {}\n", first_line, checkpoint.channel,
                                 checkpoint.number, crypto::hex(checkpoint.hash), checkpoint.records.size());
  text += checkpoint.records;
  return text + std::string(sum_word) + crypto::hex(crypto::sha256(text)) + "\n";
}

Result<Checkpoint> checkpoint_from(std::string_view text) {
  const Error damaged{"it is damaged"};
  if (!text.starts_with(first_line)) return Error{"it is no checkpoint of this version"};
  const auto sum_at = text.rfind(sum_word);
  if (sum_at == std::string_view::npos ||
      text.substr(sum_at) != fmt::format("{}{}\n", sum_word, crypto::hex(crypto::sha256(text.substr(0, sum_at)))))
    return damaged;
  std::string_view rest = text.substr(first_line.size(), sum_at - first_line.size());
  const auto channel = take_line(rest, "channel ");
  const auto number = number_of(take_line(rest, "block "));
  auto hash = hash_of(take_line(rest, "hash "));
  const auto size = number_of(take_line(rest, "records "));
  if (!channel || !number || !hash || !size || *size != rest.size()) return damaged;
  return Checkpoint{std::string(*channel), *number, std::move(*hash), std::string(rest)};
}

Result<std::optional<Checkpoint>> read_checkpoint(const std::string& path, const std::string& channel) {
  if (path.empty()) return std::optional<Checkpoint>();
  std::error_code error;
  if (std::filesystem::symlink_status(path, error).type() == std::filesystem::file_type::not_found)
    return std::optional<Checkpoint>();
  const auto unusable = [&](const std::string& why) {
    return Error{fmt::format(
        "output.checkpoint: {}: {}. Compare the peer's newest block with another organisation's; then remove the file: "
        "the next start trusts what the peer of [ledger] serves",
        path, why)};
  };
  const auto text = read_file(path);
  if (!text || text->empty()) return unusable("it cannot be read, or is empty");
  auto read = checkpoint_from(*text);
  if (!read) return unusable(read.error().message);
  if (read->channel != channel)
    return unusable(fmt::format("it is of channel {}, not of {}", printable(read->channel), channel));
  return std::optional(std::move(*read));
}

Status write_checkpoint(const std::string& path, const Checkpoint& checkpoint) {
  if (auto status = replace_file(path, to_text(checkpoint), 0600); !status)
    return Error{fmt::format("output.checkpoint: {}", status.error().message)};
  return done;
}

Result<Continuation> continue_behind(const LastVerified& verified, const common::Block& newest,
                                     const std::function<Result<common::Block>(std::uint64_t number)>& fetch) {
  const Checkpoint& last = verified.last;
  const std::uint64_t height = newest.header().number();
  if (height < last.number)
    return Error{
        fmt::format("the peer serves a chain that ends at block {}; we have verified block {}: it lags behind, or "
                    "serves an old chain (one restored on purpose: docs/ledger.md#checkpoints)",
                    height, last.number)};
  std::string hash = header_hash(newest.header());
  if (height > last.number) {
    const auto block = fetch(last.number);
    if (!block) return block.error();
    if (header_hash(block->header()) != last.hash) hash.clear();
  } else if (hash != last.hash) {
    hash.clear();
  }
  if (hash.empty())
    return Error{fmt::format(
        "the peer serves another block {} than the one that we have verified: a fork, or the channel was recreated "
        "(then remove the checkpoint's file)",
        last.number)};
  if (height - last.number <= verified.max_absence_blocks)
    return Continuation{ChainCheck::behind(last.number, last.hash), last.number, height, false};
  return Continuation{ChainCheck::behind(height, std::move(hash)), last.number, height, true};
}

CheckpointWriter::CheckpointWriter(std::string path, std::function<void(const std::string&)> on_problem,
                                   TimeNs period_ns)
    : path_(std::move(path)), on_problem_(std::move(on_problem)), period_ns_(period_ns), thread_([this] { run(); }) {}

CheckpointWriter::~CheckpointWriter() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  wake_.notify_all();
  end_.notify_all();
  thread_.join();
}

void CheckpointWriter::store(Checkpoint newest) {
  {
    const std::lock_guard lock(mutex_);
    newest_ = std::move(newest);
  }
  wake_.notify_all();
}

void CheckpointWriter::run() {
  ::pthread_setname_np(::pthread_self(), "checkpoint");
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return stopping_ || newest_; });
    if (!newest_) return;  // stopping
    const auto checkpoint = std::exchange(newest_, std::nullopt);
    lock.unlock();
    write(*checkpoint);
    lock.lock();
    end_.wait_for(lock, std::chrono::nanoseconds(period_ns_), [this] { return stopping_; });
  }
}

void CheckpointWriter::write(const Checkpoint& checkpoint) {
  const Status status = write_checkpoint(path_, checkpoint);
  if (!status && !problem_reported_ && on_problem_) on_problem_(status.error().message);
  problem_reported_ = !status;
}

}  // namespace ledgerline::fabric
