#include "common/config/config.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <cmath>
#include <set>
#include <sstream>

#include "common/base/printable.hpp"

namespace ledgerline {
namespace {

constexpr std::size_t max_text = 1'000;  // a path, even in a message
constexpr std::size_t max_key = 200;     // as shown; a damaged file may hold any

Error parse_error(const std::string& name, const toml::parse_error& e) {
  return Error{fmt::format("{}:{}: {}", name, e.source().begin.line, printable(e.description()))};
}

}  // namespace

struct Config::State {
  std::string name;
  toml::table root;
  std::set<std::string> asked;
  std::vector<std::string> problems;

  // "drone.0.name" walks tables by name and arrays by index.
  const toml::node* find(const std::string& key) {
    asked.insert(key);
    const toml::node* node = &root;
    std::istringstream parts(key);
    for (std::string part; node && std::getline(parts, part, '.');) {
      if (const auto* table = node->as_table()) {
        node = table->get(part);
      } else if (const auto* array = node->as_array();
                 array && part.find_first_not_of("0123456789") == std::string::npos) {
        node = array->get(std::stoul(part));
      } else {
        node = nullptr;
      }
    }
    return node;
  }
  void problem(const toml::node* node, const std::string& key, const std::string& what) {
    const std::string line = node ? fmt::format(":{}", node->source().begin.line) : "";
    problems.push_back(fmt::format("{}{}: {}: {}", name, line, printable(key, max_key), printable(what)));
  }
  void missing(const std::string& key, const std::string& wanted) {
    problem(nullptr, key, fmt::format("is missing ({})", wanted));
  }
  void find_unknown(const toml::node& node, const std::string& prefix) {
    if (const auto* table = node.as_table()) {
      for (const auto& [key, child] : *table) {
        find_unknown(child, prefix.empty() ? std::string(key.str()) : prefix + "." + std::string(key.str()));
      }
    } else if (const auto* array = node.as_array(); array && array->is_array_of_tables()) {
      for (std::size_t i = 0; i < array->size(); ++i) find_unknown(*array->get(i), prefix + "." + std::to_string(i));
    } else if (!asked.contains(prefix)) {
      problem(&node, prefix, "unknown key");
    }
  }
};

Config::Config(std::unique_ptr<State> state) : state_(std::move(state)) {}
Config::Config(Config&&) noexcept = default;
Config& Config::operator=(Config&&) noexcept = default;
Config::~Config() = default;

Result<Config> Config::load(const std::string& path) {
  auto state = std::make_unique<State>();
  state->name = path;
  try {
    state->root = toml::parse_file(path);
  } catch (const toml::parse_error& e) {
    return parse_error(path, e);
  }
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

std::string Config::text(const std::string& key) {
  if (!state_->find(key)) {
    state_->missing(key, "a string");
    return {};
  }
  return text(key, "");
}

std::string Config::text(const std::string& key, const std::string& otherwise) {
  const toml::node* node = state_->find(key);
  if (!node) return otherwise;
  const auto* value = node->as_string();
  if (value && printable(value->get(), max_text) == value->get()) return value->get();
  state_->problem(node, key,
                  value ? fmt::format("must be one line of text without control characters, at most {} bytes", max_text)
                        : "must be a string");
  return otherwise;
}

std::string Config::choice(const std::string& key, const std::vector<std::string>& allowed,
                           const std::string& otherwise) {
  const std::string value = text(key, otherwise);
  for (const auto& a : allowed) {
    if (a == value) return value;
  }
  state_->problem(state_->find(key), key, fmt::format("is \"{}\", must be one of {}", value, fmt::join(allowed, ", ")));
  return otherwise;
}

double Config::number(const std::string& key, double min, double max) {
  if (!state_->find(key)) {
    state_->missing(key, fmt::format("a number from {} to {}", min, max));
    return min;
  }
  return number(key, min, min, max);
}

double Config::number(const std::string& key, double otherwise, double min, double max) {
  const toml::node* node = state_->find(key);
  if (!node) return otherwise;
  const auto value = node->is_number() ? node->value<double>() : std::nullopt;
  if (!value || !(*value >= min && *value <= max)) {
    state_->problem(node, key, fmt::format("must be a number from {} to {}", min, max));
    return otherwise;
  }
  return *value;
}

std::int64_t Config::integer(const std::string& key, std::int64_t otherwise, std::int64_t min, std::int64_t max) {
  const toml::node* node = state_->find(key);
  if (!node) return otherwise;
  const auto* value = node->as_integer();
  if (!value || value->get() < min || value->get() > max) {
    state_->problem(node, key, fmt::format("must be a whole number from {} to {}", min, max));
    return otherwise;
  }
  return value->get();
}

bool Config::boolean(const std::string& key, bool otherwise) { return boolean(key).value_or(otherwise); }

std::optional<bool> Config::boolean(const std::string& key) {
  const toml::node* node = state_->find(key);
  if (!node) return std::nullopt;
  if (const auto* value = node->as_boolean()) return value->get();
  state_->problem(node, key, "must be true or false");
  return std::nullopt;
}

std::vector<double> Config::numbers(const std::string& key, std::size_t count, const std::vector<double>& otherwise) {
  const toml::node* node = state_->find(key);
  if (!node) return otherwise;
  std::vector<double> values;
  if (const auto* array = node->as_array()) {
    for (const auto& element : *array) {
      if (const auto value = element.value<double>(); value && std::isfinite(*value)) values.push_back(*value);
    }
    if (values.size() == array->size() && values.size() == count) return values;
  }
  state_->problem(node, key, fmt::format("must be {} numbers, as in [1.0, 2.0]", count));
  return otherwise;
}

std::vector<std::string> Config::texts(const std::string& key, std::size_t most) {
  const toml::node* node = state_->find(key);
  if (!node) return {};
  std::vector<std::string> values;
  const auto* array = node->as_array();
  for (std::size_t i = 0; array && i < array->size() && i < most; ++i) {
    const auto* value = array->get_as<std::string>(i);
    if (!value || printable(value->get(), max_text) != value->get()) break;
    values.push_back(value->get());
  }
  if (array && values.size() == array->size()) return values;
  state_->problem(node, key,
                  fmt::format("must be a list of at most {} texts of one line each, as in [\"...\", \"...\"]", most));
  return {};
}

std::size_t Config::table_count(const std::string& key) {
  const toml::node* node = state_->find(key);
  if (!node) return 0;
  const auto* array = node->as_array();
  if (array && array->is_array_of_tables()) return array->size();
  state_->problem(node, key, fmt::format("must be tables, each beginning with [[{}]]", key));
  return 0;
}

void Config::wrong(const std::string& key, const std::string& what) { state_->problem(state_->find(key), key, what); }

Status Config::finish() {
  state_->find_unknown(state_->root, "");
  if (state_->problems.empty()) return done;
  return Error{fmt::format("{}", fmt::join(state_->problems, "\n"))};
}

}  // namespace ledgerline
