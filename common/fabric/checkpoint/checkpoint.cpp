#include "common/fabric/checkpoint/checkpoint.hpp"

#include <fmt/format.h>

#include <charconv>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/crypto/unhex.hpp"

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
  if (!text) return unusable("it cannot be read, or is empty");
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

}  // namespace ledgerline::fabric
