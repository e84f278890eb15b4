#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline {

/// Reads one TOML file with every key checked: a program asks for each key it knows, then calls finish(). A key of the
/// wrong type, out of range, missing without a default, or in the file but never asked for is an error; all of them
/// come at once from finish(), each as "FILE:LINE: key: what is wrong, what is allowed". One thread.
///
///     auto config = Config::load("link.toml");           // Result<Config>
///     auto rate = config->number("state.rate_hz", 30.0, 1, 200);
///     for (std::size_t i = 0; i < config->table_count("drone"); ++i)   // [[drone]]
///       auto name = config->text("drone." + std::to_string(i) + ".name");
///     if (auto s = config->finish(); !s) ...
class Config {
 public:
  static Result<Config> load(const std::string& path);
  static Result<Config> parse(std::string_view toml, const std::string& name);
  Config(Config&&) noexcept;
  Config& operator=(Config&&) noexcept;
  ~Config();

  /// With a default the key may be missing; without one it must be there. One line, no control characters: texts become
  /// names, paths and messages.
  std::string text(const std::string& key);
  std::string text(const std::string& key, const std::string& otherwise);
  /// Must be one of `allowed`.
  std::string choice(const std::string& key, const std::vector<std::string>& allowed, const std::string& otherwise);
  double number(const std::string& key, double min, double max);
  double number(const std::string& key, double otherwise, double min, double max);
  std::int64_t integer(const std::string& key, std::int64_t otherwise, std::int64_t min, std::int64_t max);
  bool boolean(const std::string& key, bool otherwise);
  std::optional<bool> boolean(const std::string& key);  ///< nullopt where the key is missing, and where it is wrong
  std::vector<double> numbers(const std::string& key, std::size_t count, const std::vector<double>& otherwise);
  /// A list of texts, each as text(); empty where the key is missing.
  std::vector<std::string> texts(const std::string& key, std::size_t most);
  /// Number of [[key]] tables; their keys are then "key.0.x", "key.1.x" ...
  std::size_t table_count(const std::string& key);
  /// What the program itself finds wrong with a key's value, for finish(): "must ...".
  void wrong(const std::string& key, const std::string& what);

  Status finish();

 private:
  struct State;
  explicit Config(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace ledgerline
