#pragma once
#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <span>
#include <string>
#include <string_view>

// What an SDK command's words mean, and the answer to one that is none.
namespace ledgerline::sim {

inline std::optional<int> number(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// All words as numbers, or nothing.
template <std::size_t N>
std::optional<std::array<int, N>> numbers(std::span<const std::string_view> words) {
  if (words.size() != N) return std::nullopt;
  std::array<int, N> values{};
  for (std::size_t i = 0; i < N; ++i) {
    const auto value = number(words[i]);
    if (!value) return std::nullopt;
    values[i] = *value;
  }
  return values;
}

inline bool within(int value, int low, int high) { return value >= low && value <= high; }

/// m1 to m8; -1 for m-1, -2 for m-2: any pad, and the nearest.
inline std::optional<int> pad_id(std::string_view word) {
  if (word.empty() || word[0] != 'm') return std::nullopt;
  const auto id = number(word.substr(1));
  return id && (within(*id, 1, 8) || within(*id, -2, -1)) ? id : std::nullopt;
}

/// djitellopy takes any text with "ok" in it for a success, so the echo is left out of such a one.
inline std::string unknown(std::string_view name) {
  std::string echo;
  for (const char c : name)
    if (c > ' ' && c <= '~') echo += c;
  std::string lower = echo;
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  if (lower.find("ok") != std::string::npos) echo.clear();
  return "unknown command: " + echo;
}

}  // namespace ledgerline::sim
