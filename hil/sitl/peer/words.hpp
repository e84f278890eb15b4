#pragma once
#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// The words of scripts for the values of an enumeration, in a table of pairs.
namespace ledgerline::hil {

template <typename Value, std::size_t count>
using WordTable = std::array<std::pair<std::string_view, Value>, count>;

template <typename Value, std::size_t count>
std::optional<Value> value_of(const WordTable<Value, count>& words, std::string_view word) {
  for (const auto& [name, value] : words) {
    if (name == word) return value;
  }
  return std::nullopt;
}

template <typename Value, std::size_t count>
std::vector<std::string> names_of(const WordTable<Value, count>& words) {
  std::vector<std::string> names;
  for (const auto& pair : words) names.emplace_back(pair.first);
  return names;
}

/// For errors.
inline std::string list_of(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

}  // namespace ledgerline::hil
