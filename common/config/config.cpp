#include "common/config/config.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <set>
#include <sstream>

#include "common/base/nearest_word.hpp"
#include "common/base/text.hpp"

namespace ledgerline {
namespace {

constexpr std::size_t max_text = 1'000;  // a path, even in a message
constexpr std::size_t max_key = 200;     // as shown; a damaged file may hold any

// Keys of the release before: what they are now.
constexpr auto renamed_keys = std::to_array<std::pair<std::string_view, std::string_view>>({
    {"agent.beat_ms", "agent.heartbeat_ms"},
    {"agent.doubt_s", "agent.integrity_hold_s"},
    {"batch.longest_back_off_ms", "batch.max_back_off_ms"},
    {"failsafe.doubt", "failsafe.on_untrusted_ledger"},
    {"flight.doubt", "flight.on_untrusted_ledger"},
    {"flight.told_mps", "flight.full_scale_mps"},
    {"flight.told_mps2", "flight.max_acceleration_mps2"},
    {"ledger.patience", "ledger.timeouts"},
    {"mocap.longest_gap_ms", "mocap.max_gap_ms"},
    {"patience_s", "timeout_s"},
    {"pose.own_senses_after_ms", "pose.odometry_after_ms"},
});

Error parse_error(const std::string& name, const toml::parse_error& e) {
  const auto line = e.source().begin.line;  // 0: the file cannot be read
  return Error{fmt::format("{}{}: {}", name, line > 0 ? fmt::format(":{}", line) : "", printable(e.description()))};
}

// The house writes units into names; the reference reads them there.
std::string_view unit_of(std::string_view name) {
  constexpr std::pair<std::string_view, std::string_view> units[] = {
      {"_radps2", "rad/s²"}, {"_mps2", "m/s²"}, {"_radps", "rad/s"}, {"_mps", "m/s"}, {"_hz", "Hz"},
      {"_ms", "ms"},         {"_m", "m"},       {"_s", "s"},         {"seconds", "s"}};
  for (const auto& [suffix, unit] : units) {
    if (name.ends_with(suffix)) return unit;
  }
  return "";
}

bool is_index(std::string_view part) { return part.find_first_not_of("0123456789") == std::string_view::npos; }

// "drone.0.name" -> "[[drone]]", "name".
std::pair<std::string, std::string> table_and_key(std::string_view name) {
  const std::size_t last = name.rfind('.');
  if (last == std::string_view::npos) return {"", std::string(name)};
  std::string_view table = name.substr(0, last);
  const std::size_t index = table.rfind('.');
  const bool repeated = index != std::string_view::npos && is_index(table.substr(index + 1));
  if (repeated) table = table.substr(0, index);
  return {fmt::format(fmt::runtime(repeated ? "[[{}]]" : "[{}]"), table), std::string(name.substr(last + 1))};
}

std::string quoted(const std::string& text) { return text.empty() ? "none" : fmt::format("\"{}\"", text); }

constexpr const char* must_be_there = "";

/// For programs: what `allowed` says in words.
struct Bounds {
  std::optional<double> min{}, max{};
  std::vector<std::string> choices{};
};

}  // namespace

struct Config::State {
  std::string name;
  toml::table root;
  std::set<std::string> asked;
  std::vector<std::string> problems;
  bool describing = false;
  std::vector<KeyDescription> described;

  void describe(const Key& key, const char* type, const std::string& usual, const std::string& allowed,
                const Bounds& bounds = {}) {
    if (!describing) return;
    auto [table, within] = table_and_key(key.name);
    for (const KeyDescription& other : described) {
      if (other.table == table && other.key == within) return;
    }
    std::string unit(unit_of(within));
    described.push_back({std::move(table), std::move(within), type, std::move(unit),
                         key.otherwise.empty() ? usual : std::string(key.otherwise), allowed, std::string(key.about),
                         bounds.min, bounds.max, bounds.choices, std::string(key.pattern)});
  }

  // "drone.0.name" walks tables by name and arrays by index.
  const toml::node* find(const std::string& key) {
    asked.insert(key);
    const toml::node* node = &root;
    std::istringstream parts(key);
    for (std::string part; node && std::getline(parts, part, '.');) {
      if (const auto* table = node->as_table()) {
        node = table->get(part);
      } else if (const auto* array = node->as_array(); array && is_index(part)) {
        node = array->get(std::stoul(part));
      } else {
        node = nullptr;
      }
    }
    return node;
  }
  void problem(const toml::node* node, const std::string& key, const std::string& what) {
    const std::string line = node ? fmt::format(":{}", node->source().begin.line) : "";
    std::string words = fmt::format("{}{}: {}: {}", name, line, printable(key, max_key), printable(what));
    if (std::ranges::find(problems, words) == problems.end()) problems.push_back(std::move(words));
  }
  void take_all(const toml::node& node, const std::string& prefix) {
    asked.insert(prefix);
    if (const auto* table = node.as_table()) {
      for (const auto& [key, child] : *table) take_all(child, prefix + "." + std::string(key.str()));
    } else if (const auto* array = node.as_array()) {
      for (std::size_t i = 0; i < array->size(); ++i) take_all(*array->get(i), prefix + "." + std::to_string(i));
    }
  }
  void find_unknown(const toml::node& node, const std::string& prefix) {
    if (const auto* table = node.as_table()) {
      for (const auto& [key, child] : *table) {
        find_unknown(child, prefix.empty() ? std::string(key.str()) : prefix + "." + std::string(key.str()));
      }
    } else if (const auto* array = node.as_array(); array && array->is_array_of_tables()) {
      for (std::size_t i = 0; i < array->size(); ++i) find_unknown(*array->get(i), prefix + "." + std::to_string(i));
    } else if (!asked.contains(prefix)) {
      const auto now =
          std::find_if(renamed_keys.begin(), renamed_keys.end(), [&](const auto& key) { return key.first == prefix; });
      problem(&node, prefix,
              now == renamed_keys.end() ? "unknown key" + guess_for(prefix) : fmt::format("is {} now", now->second));
    }
  }
  /// Among the keys of its table.
  std::string guess_for(const std::string& unknown) const {
    const std::size_t key = unknown.rfind('.') + 1;  // 0: of no table
    std::vector<std::string> known;
    for (const std::string& one : asked) {
      if (one.rfind('.') + 1 == key && one.starts_with(unknown.substr(0, key))) known.push_back(one.substr(key));
    }
    return did_you_mean(": ", unknown.substr(key), known);
  }
};

Config::Config(std::unique_ptr<State> state) : state_(std::move(state)) {}
Config::Config(Config&&) noexcept = default;
Config& Config::operator=(Config&&) noexcept = default;
Config::~Config() = default;

Result<Config> Config::load(const std::string& path) {
  auto state = std::make_unique<State>();
  state->name = path;
  if (!std::ifstream(path)) return Error{fmt::format("{}: {}", path, std::strerror(errno))};
  try {
    state->root = toml::parse_file(path);
  } catch (const toml::parse_error& e) {
    return parse_error(path, e);
  }
  return Config(std::move(state));
}

Config Config::describing() {
  auto state = std::make_unique<State>();
  state->describing = true;
  return Config(std::move(state));
}

Result<Config> Config::parse(std::string_view text, const std::string& name) {
  auto state = std::make_unique<State>();
  state->name = name;
  try {
    state->root = toml::parse(text, name);
  } catch (const toml::parse_error& e) {
    return parse_error(name, e);
  }
  return Config(std::move(state));
}

std::string Config::text(const Key& key) {
  state_->describe(key, "text", must_be_there, "");
  if (!state_->find(key.name)) {
    state_->problem(nullptr, key.name, "is missing (a string)");
    return {};
  }
  return text(key, "");
}

std::string Config::text(const Key& key, const std::string& otherwise) {
  state_->describe(key, "text", quoted(otherwise), "");
  const toml::node* node = state_->find(key.name);
  if (!node) return otherwise;
  const auto* value = node->as_string();
  if (value && printable(value->get(), max_text) == value->get()) return value->get();
  state_->problem(node, key.name,
                  value ? fmt::format("must be one line of text without control characters, at most {} bytes", max_text)
                        : "must be a string");
  return otherwise;
}

std::string Config::choice(const Key& key, const std::vector<std::string>& allowed, const std::string& otherwise) {
  state_->describe(key, "text", quoted(otherwise), fmt::format("{}", fmt::join(allowed, ", ")), {.choices = allowed});
  const std::string value = text(key, otherwise);
  if (std::ranges::find(allowed, value) != allowed.end()) return value;
  state_->problem(state_->find(key.name), key.name,
                  fmt::format("is \"{}\", must be one of {}", value, fmt::join(allowed, ", ")));
  return otherwise;
}

double Config::number(const Key& key, double min, double max) {
  state_->describe(key, "number", must_be_there, fmt::format("{} to {}", min, max), {.min = min, .max = max});
  if (!state_->find(key.name)) {
    state_->problem(nullptr, key.name, fmt::format("is missing (a number from {} to {})", min, max));
    return min;
  }
  return number(key, min, min, max);
}

double Config::number(const Key& key, double otherwise, double min, double max) {
  state_->describe(key, "number", fmt::format("{:.4g}", otherwise), fmt::format("{} to {}", min, max),
                   {.min = min, .max = max});
  const toml::node* node = state_->find(key.name);
  if (!node) return otherwise;
  const auto value = node->is_number() ? node->value<double>() : std::nullopt;
  if (!value || !(*value >= min && *value <= max)) {
    state_->problem(node, key.name, fmt::format("must be a number from {} to {}", min, max));
    return otherwise;
  }
  return *value;
}

std::int64_t Config::integer(const Key& key, std::int64_t otherwise, std::int64_t min, std::int64_t max) {
  const bool bounded = max != std::numeric_limits<std::int64_t>::max();
  state_->describe(
      key, "whole number", fmt::format("{}", otherwise),
      bounded ? fmt::format("{} to {}", min, max) : fmt::format("{} or more", min),
      {.min = static_cast<double>(min), .max = bounded ? std::optional(static_cast<double>(max)) : std::nullopt});
  const toml::node* node = state_->find(key.name);
  if (!node) return otherwise;
  const auto* value = node->as_integer();
  if (!value || value->get() < min || value->get() > max) {
    state_->problem(node, key.name, fmt::format("must be a whole number from {} to {}", min, max));
    return otherwise;
  }
  return value->get();
}

bool Config::boolean(const Key& key, bool otherwise) {
  state_->describe(key, "true or false", otherwise ? "true" : "false", "");
  return boolean(key).value_or(otherwise);
}

std::optional<bool> Config::boolean(const Key& key) {
  state_->describe(key, "true or false", "none", "");
  const toml::node* node = state_->find(key.name);
  if (!node) return std::nullopt;
  if (const auto* value = node->as_boolean()) return value->get();
  state_->problem(node, key.name, "must be true or false");
  return std::nullopt;
}

std::vector<double> Config::numbers(const Key& key, std::size_t count, const std::vector<double>& otherwise) {
  state_->describe(key, "numbers", fmt::format("[{}]", fmt::join(otherwise, ", ")), fmt::format("{} of them", count),
                   {.min = static_cast<double>(count), .max = static_cast<double>(count)});
  const toml::node* node = state_->find(key.name);
  if (!node) return otherwise;
  std::vector<double> values;
  if (const auto* array = node->as_array()) {
    for (const auto& element : *array) {
      if (const auto value = element.value<double>(); value && std::isfinite(*value)) values.push_back(*value);
    }
    if (values.size() == array->size() && values.size() == count) return values;
  }
  state_->problem(node, key.name, fmt::format("must be {} numbers, as in [1.0, 2.0]", count));
  return otherwise;
}

std::vector<std::string> Config::texts(const Key& key, std::size_t max) {
  state_->describe(key, "texts", "[]", fmt::format("at most {}", max), {.max = static_cast<double>(max)});
  const toml::node* node = state_->find(key.name);
  if (!node) return {};
  std::vector<std::string> values;
  const auto* array = node->as_array();
  for (std::size_t i = 0; array && i < array->size() && i < max; ++i) {
    const auto* value = array->get_as<std::string>(i);
    if (!value || printable(value->get(), max_text) != value->get()) break;
    values.push_back(value->get());
  }
  if (array && values.size() == array->size()) return values;
  state_->problem(node, key.name,
                  fmt::format("must be a list of at most {} texts of one line each, as in [\"...\", \"...\"]", max));
  return {};
}

std::size_t Config::table_count(const Key& key) {
  if (state_->describing) {
    state_->describe({key.name + ".0.", key.about}, "tables", "none", "");
    return 1;
  }
  const toml::node* node = state_->find(key.name);
  if (!node) return 0;
  const auto* array = node->as_array();
  if (array && array->is_array_of_tables()) return array->size();
  state_->problem(node, key.name, fmt::format("must be tables, each beginning with [[{}]]", key.name));
  return 0;
}

std::string Config::table_text(const std::string& key, std::initializer_list<std::string_view> without) const {
  const toml::node* node = state_->root.get(key);
  toml::table alone;
  if (node && node->is_table()) {
    toml::table kept = *node->as_table();
    for (const std::string_view left_out : without) kept.erase(left_out);
    alone.insert(key, std::move(kept));
  }
  if (node && node->is_array_of_tables()) alone.insert(key, *node->as_array());
  if (alone.empty()) return "";
  std::ostringstream out;
  out << alone << "\n";
  return out.str();
}

void Config::add_table(const Config& other, const std::string& key, std::initializer_list<std::string_view> without) {
  const toml::table* from = other.state_->root.get_as<toml::table>(key);
  if (!from) return;
  toml::node* node = state_->root.get(key);
  if (!node) node = &state_->root.insert(key, toml::table{}).first->second;
  toml::table* into = node->as_table();
  if (!into) return;  // who asks for its keys finds that out
  for (const auto& [name, value] : *from) {
    if (std::find(without.begin(), without.end(), name.str()) != without.end()) continue;
    if (into->contains(name.str()))
      state_->problem(into->get(name.str()), key + "." + std::string(name.str()),
                      "stands in " + other.state_->name + ", too");
    else
      into->insert(name.str(), value);
  }
}

void Config::skip_table(const Key& table) {
  state_->describe(table, "table", "none", "");
  if (const toml::node* node = state_->find(table.name)) state_->take_all(*node, table.name);
}

void Config::wrong(const std::string& key, const std::string& what) { state_->problem(state_->find(key), key, what); }

bool Config::is_describing() const { return state_->describing; }

std::vector<KeyDescription> Config::described() const { return state_->described; }

Status Config::finish() {
  state_->find_unknown(state_->root, "");
  if (state_->problems.empty()) return done;
  return Error{fmt::format("{}", fmt::join(state_->problems, "\n"))};
}

}  // namespace ledgerline
