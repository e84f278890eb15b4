#pragma once
#include <array>
#include <cstddef>
#include <string_view>
#include <utility>

namespace ledgerline {

/// Whether the value has a name in its enumeration: gcc and clang spell one that has none as a cast, "(Enum)7".
template <auto value>
constexpr bool is_enumerator() noexcept {
  const std::string_view spelled = __PRETTY_FUNCTION__;
  const std::size_t at = spelled.find("value = ") + 8;
  return at < spelled.size() && spelled[at] != '(' && (spelled[at] < '0' || spelled[at] > '9') && spelled[at] != '-';
}

/// As it is written in its enumeration: "taking_off".
template <auto value>
constexpr std::string_view enumerator_name() noexcept {
  std::string_view spelled = __PRETTY_FUNCTION__;
  spelled.remove_prefix(spelled.find("value = ") + 8);
  spelled = spelled.substr(0, spelled.find_first_of(";]"));
  return spelled.substr(spelled.rfind(':') + 1);
}

template <typename Enum, std::size_t begin = 0>
constexpr std::size_t count_enumerators() noexcept {
  if constexpr (is_enumerator<static_cast<Enum>(begin)>()) {
    return count_enumerators<Enum, begin + 1>();
  } else {
    return begin;
  }
}

/// How many values an enumeration has that are numbered 0, 1, 2 ... without a gap. Tables by such a value are of this
/// size, or assert it: so an enumerator that is added without its entry does not compile.
template <typename Enum>
inline constexpr std::size_t enum_count = count_enumerators<Enum>();

/// Of names in the order of the values; `otherwise` for a value that is none.
template <typename Enum, std::size_t count>
constexpr const char* name_of(Enum value, const std::array<const char*, count>& names,
                              const char* otherwise = "unknown") noexcept {
  static_assert(count == enum_count<Enum>);
  const auto at = static_cast<std::size_t>(value);
  return at < count ? names[at] : otherwise;
}

template <typename Enum, std::size_t... i>
constexpr auto name_enumerators(std::index_sequence<i...>) noexcept {
  return std::array{enumerator_name<static_cast<Enum>(i)>()...};
}

/// The names of such an enumeration, by value.
template <typename Enum>
inline constexpr auto enum_names = name_enumerators<Enum>(std::make_index_sequence<enum_count<Enum>>());

/// As it is written in its enumeration; "unknown" for a value that is none.
template <typename Enum>
constexpr std::string_view enum_name(Enum value) noexcept {
  const auto at = static_cast<std::size_t>(value);
  return at < enum_count<Enum> ? enum_names<Enum>[at] : "unknown";
}

}  // namespace ledgerline
