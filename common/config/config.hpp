#pragma once
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline {

/// A key and what the reference (docs/configuration.md) says about it: what it does, and why its default and its range
/// are what they are. The unit stands in the name ("_ms", "_mps").
struct Key {
  Key(const char* key) : name(key) {}
  Key(std::string key) : name(std::move(key)) {}
  Key(std::string key, std::string_view what, std::string_view default_words = {})
      : name(std::move(key)), about(what), otherwise(default_words) {}

  /// Of a text: what it must look like, as a regular expression (ECMA 262). For editors; the reader checks by itself.
  Key&& like(std::string_view a_pattern) && {
    pattern = a_pattern;
    return std::move(*this);
  }

  std::string name;
  std::string_view about;      ///< a literal
  std::string_view otherwise;  ///< the default in words, where the value itself would say too little; a literal
  std::string_view pattern;    ///< a literal
};

/// What a reader asked a describing Config for, in the reference's words.
struct KeyDescription {
  std::string table;    ///< "[state]", "[[drone]]"; empty: the top of the file
  std::string key;      ///< within the table; empty: this is about the table
  std::string type;     ///< "text", "whole number" ...
  std::string unit;     ///< "ms", "m/s"; empty: none
  std::string usual;    ///< the default; empty: the key must be there
  std::string allowed;  ///< empty: anything of its type
  std::string about;
  // The same for programs.
  std::optional<double> min, max;    ///< of a number; of texts: how many there may be
  std::vector<std::string> choices;  ///< of a text; empty: any
  std::string pattern;               ///< of a text; empty: any
};

/// Reads one TOML file with every key checked: a program asks for each key it knows, then calls finish(). A key of the
/// wrong type, out of range, missing without a default, or in the file but never asked for is an error; all of them
/// come at once from finish(), each as "FILE:LINE: key: what is wrong, what is allowed". One thread.
///
///     auto config = Config::load("link.toml");           // Result<Config>
///     auto rate = config->number("state.rate_hz", 30.0, 1, 200);
///     for (std::size_t i = 0; i < config->table_count("drone"); ++i)   // [[drone]]
///       auto name = config->text("drone." + std::to_string(i) + ".name");
///     if (auto s = config->finish(); !s) ...
///
/// A describing one has no file: each key is missing, each [[table]] is there once, and described() lists what was
/// asked for.
class Config {
 public:
  static Result<Config> load(const std::string& path);
  static Result<Config> parse(std::string_view toml, const std::string& name);
  static Config describing();
  Config(Config&&) noexcept;
  Config& operator=(Config&&) noexcept;
  ~Config();

  /// With a default the key may be missing; without one it must be there. One line, no control characters: texts become
  /// names, paths and messages.
  std::string text(const Key& key);
  std::string text(const Key& key, const std::string& otherwise);
  /// Must be one of `allowed`.
  std::string choice(const Key& key, const std::vector<std::string>& allowed, const std::string& otherwise);
  double number(const Key& key, double min, double max);
  double number(const Key& key, double otherwise, double min, double max);
  std::int64_t integer(const Key& key, std::int64_t otherwise, std::int64_t min, std::int64_t max);
  bool boolean(const Key& key, bool otherwise);
  std::optional<bool> boolean(const Key& key);  ///< nullopt where the key is missing, and where it is wrong
  std::vector<double> numbers(const Key& key, std::size_t count, const std::vector<double>& otherwise);
  /// A list of texts, each as text(); empty where the key is missing.
  std::vector<std::string> texts(const Key& key, std::size_t max);
  /// Number of [[key]] tables; their keys are then "key.0.x", "key.1.x" ...
  std::size_t table_count(const Key& key);
  /// The [table], or all [[table]] of that name, as TOML with headings, for another program's file. Empty where there
  /// is none. `without`: keys of the [table] that are not for that program.
  std::string table_text(const std::string& key, std::initializer_list<std::string_view> without = {}) const;
  /// Adds the keys of another file's [table] to this one's, before they are asked for; a key that both have is wrong
  /// here. `without`: keys that are not for this file.
  void add_table(const Config& other, const std::string& key, std::initializer_list<std::string_view> without = {});
  /// Another program checks what is in this table, which goes into its file: here none of its keys is unknown.
  void skip_table(const Key& table);
  /// What the program itself finds wrong with a key's value, for finish(): "must ...".
  void wrong(const std::string& key, const std::string& what);

  /// True of a describing Config: a reader then asks for those keys, too, that only some files may have.
  bool is_describing() const;
  /// In the order of the first question for each key.
  std::vector<KeyDescription> described() const;

  Status finish();

 private:
  struct State;
  explicit Config(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace ledgerline
