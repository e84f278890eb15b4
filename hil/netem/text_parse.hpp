#pragma once
#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/enum_count.hpp"

// What scripts, commands and tables are made of.
namespace ledgerline::hil {

inline std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

/// What stands between blanks.
inline std::vector<std::string_view> words_of(std::string_view text) {
  std::vector<std::string_view> words;
  for (text = trimmed(text); !text.empty(); text = trimmed(text)) {
    const std::size_t end = std::min(text.find_first_of(" \t\r"), text.size());
    words.push_back(text.substr(0, end));
    text.remove_prefix(end);
  }
  return words;
}

/// What stands between `separator`s: at least one part, which may be empty.
inline std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(separator, begin), text.size());
    parts.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

/// All of the text as a finite number; nothing where it is none.
inline std::optional<double> parse_number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

/// "7%" as 0.07; nothing where it is no share from 0% to 100%.
inline std::optional<double> parse_share(std::string_view text) {
  if (!text.ends_with('%')) return std::nullopt;
  const auto percent = parse_number(text.substr(0, text.size() - 1));
  return percent && *percent >= 0 && *percent <= 100 ? std::optional(*percent / 100) : std::nullopt;
}

/// A number with one of these units behind it, in the unit of the scales; nothing where it is none.
inline std::optional<double> parse_with_unit(std::string_view text,
                                             std::span<const std::pair<std::string_view, double>> scales) {
  const std::size_t unit_at = std::min(text.find_first_not_of("0123456789."), text.size());
  const auto number = parse_number(text.substr(0, unit_at));
  for (const auto& [unit, scale] : scales) {
    if (number && text.substr(unit_at) == unit) return *number * scale;
  }
  return std::nullopt;
}

/// The lines of a table but empty ones and comments (#), without blanks around, each with its number from 1 on.
inline std::vector<std::pair<int, std::string_view>> lines_of(std::string_view content) {
  std::vector<std::pair<int, std::string_view>> lines;
  int number = 0;
  for (std::string_view line : split(content, '\n')) {
    ++number;
    line = trimmed(line);
    if (!line.empty() && line.front() != '#') lines.emplace_back(number, line);
  }
  return lines;
}

/// The words of scripts for the values of an enumeration but its first one, `none`: their names, with - for _.
template <typename Enum>
std::vector<std::string> words_for() {
  std::vector<std::string> words(enum_names<Enum>.begin() + 1, enum_names<Enum>.end());
  for (std::string& word : words) std::ranges::replace(word, '_', '-');
  return words;
}

template <typename Enum>
std::optional<Enum> from_word(std::string_view word) {
  const auto words = words_for<Enum>();
  const auto found = std::ranges::find(words, word);
  return found == words.end() ? std::nullopt : std::optional(static_cast<Enum>(found - words.begin() + 1));
}

}  // namespace ledgerline::hil
