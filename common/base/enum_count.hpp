#pragma once
#include <array>
#include <cstddef>
#include <string_view>

namespace ledgerline {

/// Whether the value has a name in its enumeration: gcc and clang spell one that has none as a cast, "(Enum)7".
template <auto value>
constexpr bool is_enumerator() noexcept {
  const std::string_view spelled = __PRETTY_FUNCTION__;
  const std::size_t at = spelled.find("value = ") + 8;
  return at < spelled.size() && spelled[at] != '(' && (spelled[at] < '0' || spelled[at] > '9') && spelled[at] != '-';
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

/// Of names in the order of the values; "unknown" for a value that is none.
template <typename Enum, std::size_t count>
constexpr const char* name_of(Enum value, const std::array<const char*, count>& names) noexcept {
  static_assert(count == enum_count<Enum>);
  const auto at = static_cast<std::size_t>(value);
  return at < count ? names[at] : "unknown";
}

}  // namespace ledgerline
