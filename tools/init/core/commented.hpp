#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "common/config/config.hpp"

/// A config file that a person can go on with: every key that its program reads, in the words of the reference
/// (docs/configuration.md), with values where they are known. Pure.
namespace ledgerline::init {

/// "\"raven\"", as TOML writes a text.
std::string toml(std::string_view text);

/// A value for one key.
struct Value {
  std::string table;      ///< "[ledger]", "[[drone]]"; empty: the top of the file
  std::size_t place = 0;  ///< which [[table]] of that name
  std::string key;
  std::string value;  ///< TOML
};

/// `keys`: of one file, in the reader's order. A key without a value stands there as a comment with its default; so
/// does a whole [[table]] that has none. The comments of a [[table]] are at its first one alone. An error: a value of a
/// key that the program does not read, or a [[table]] whose places have a gap.
Result<std::string> commented(const std::string& heading, const std::vector<KeyDescription>& keys,
                              const std::vector<Value>& values);

}  // namespace ledgerline::init
