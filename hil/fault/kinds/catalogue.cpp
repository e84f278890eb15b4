#include "hil/fault/kinds/fault.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <optional>

#include "common/base/enum_count.hpp"
#include "common/config/config.hpp"
#include "common/msg/names.hpp"
#include "hil/fault/script.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

/// What stands for a word in capitals, behind that word in lower case; behind any where `behind` is empty.
struct Stand {
  std::string_view behind, word, example;
};
constexpr Stand stand_ins[] = {
    {"lies", "WHAT...", "chain"},
    {"serves", "WHAT...", "hides-commands"},
    {"orders", "WHAT...", "hides-commands"},
    {"errs", "WHAT...", "boot"},
    {"relay", "LIE...", "plan-speed"},
    {"answers", "WHAT...", "late 300ms"},
    {"states", "WHAT...", "torn"},
    {"ledger", "EFFECTS...", "loss 5%"},
    {"", "EFFECTS...", "delay 200ms"},
    {"", "DISTRIBUTION...", "gamma 50ms 20ms"},
    {"", "FIELD...", "h stuck"},
    {"", "NAME", "tello1"},
    {"", "SHARE", "7%"},
    {"", "X", "0.5"},
    {"", "Y", "0.1"},
    {"", "Z", "0.1"},
    {"", "DEGREES", "90"},
    {"", "METRES", "0.02"},
    {"", "CELSIUS", "97"},
    {"", "TIME", "100ms"},
    {"", "RATE", "0.05"},
    {"", "N", "1"},
    {"", "SIZE", "500MB"},
};

/// `text`: the fault as far as its words are known.
std::optional<std::string_view> example_for(std::string_view placeholder, const std::string& text) {
  const auto before = words_of(text);
  for (const Stand& stand : stand_ins) {
    const bool fits = stand.behind.empty() || std::find(before.begin(), before.end(), stand.behind) != before.end();
    if (stand.word == placeholder && fits) return stand.example;
  }
  return std::nullopt;
}

// Lasting a second, where it lasts at all: in that time each kind can be had, if ever.
Status check_example(const std::string& text, bool real, const RealStack& stack) {
  auto fault = parse_fault(text, "", "", real);
  if (fault && !fault->acts.momentary) fault = parse_fault(text, "", "1s", real);
  if (!fault) return fault.error();
  return real ? fault->acts.check_real(*fault, stack) : done;
}

InMode in_mode(const std::vector<std::string>& examples, bool real, const RealStack& stack) {
  InMode mode;
  for (const std::string& example : examples) {
    if (const Status checked = check_example(example, real, stack); checked)
      mode.possible.push_back(example);
    else
      mode.refused.emplace_back(example, checked.error().message);
  }
  return mode;
}

}  // namespace

bool is_placeholder(std::string_view word) { return std::isupper(static_cast<unsigned char>(word[0])) != 0; }

std::vector<std::string> examples_of(const FaultKind& kind) {
  std::vector<std::string> examples{""};
  for (const std::string_view word : words_of(kind.form)) {
    std::vector<std::string> longer;
    for (const std::string& text : examples) {
      std::vector<std::string_view> choices = split(word, '|');
      if (is_placeholder(word)) {
        const auto example = example_for(word, text);
        if (!example) return {};
        choices = {*example};
      }
      for (const std::string_view choice : choices)
        longer.push_back(text.empty() ? std::string(choice) : fmt::format("{} {}", text, choice));
    }
    examples = std::move(longer);
  }
  return examples;
}

KindModes modes_of(const FaultKind& kind) {
  const auto examples = examples_of(kind);
  return {&kind, in_mode(examples, false, {}), in_mode(examples, true, {.fabric = false}),
          in_mode(examples, true, {.fabric = true}), in_mode(examples, true, {.shim = true})};
}

std::string modes_text(const KindModes& modes) {
  std::vector<std::string> said;
  const auto add = [&](std::string_view name, const InMode& mode) {
    if (mode.possible.empty()) return;
    said.push_back(mode.all() ? std::string(name) : fmt::format("{}: `{}`", name, fmt::join(mode.possible, "`, `")));
  };
  add("sitl", modes.sitl);
  const bool on_both = modes.embedded.possible == modes.fabric.possible;
  add(on_both ? "real" : "real on the embedded node", modes.embedded);
  if (!on_both) add("real on Fabric", modes.fabric);
  if (modes.shim.possible != modes.embedded.possible) add("real over the shim", modes.shim);
  if (!said.empty()) return fmt::format("{}", fmt::join(said, ", "));
  return modes.sitl.refused.empty() ? "refused" : "refused: " + modes.sitl.refused.front().second;
}

namespace {

using Json = nlohmann::ordered_json;

constexpr const char* duration_pattern = R"(^[0-9.]+(us|ms|s)$)";  // of hil/netem/distribution.cpp
constexpr const char* moment_pattern =
    R"(^\s*([0-9.]+(us|ms|s)|(takeoff|flying|path|landing|landed|lap\s+\S+|height\s+\S+)(\s*\+\s*[0-9.]+(us|ms|s))?)\s*$)";

std::string choice_of(const std::vector<std::string>& words) { return fmt::format("({})", fmt::join(words, "|")); }

/// "drone NAME reboot" -> "^\s*drone\s+\S+\s+reboot\s*$"
std::string pattern_of(const FaultKind& kind) {
  std::vector<std::string> parts;
  for (const std::string_view word : words_of(kind.form)) {
    if (!is_placeholder(word))
      parts.push_back(word.find('|') == std::string_view::npos ? std::string(word) : fmt::format("({})", word));
    else
      parts.push_back(word.ends_with("...") ? R"(\S.*)" : R"(\S+)");
  }
  return fmt::format(R"(^\s*{}\s*$)", fmt::join(parts, R"(\s+)"));
}

std::string pattern_of(RuleKind::Takes takes) {
  if (takes == RuleKind::Takes::command) return choice_of({"command", "takeoff", "land", "emergency"});
  if (takes == RuleKind::Takes::mode_or_cause) {
    std::vector<std::string> words{"hold", "brake", "land", "cut"};
    for (std::size_t i = 1; i < enum_count<FailsafeCause>; ++i)
      words.push_back(fmt::format("{}", fmt::join(split(name(static_cast<FailsafeCause>(i)), '_'), R"(\s+)")));
    return choice_of(words);
  }
  constexpr std::array number_patterns{"", R"([0-9.]+\s*(ms|s))", R"([0-9.]+\s*m)", R"([0-9.]+\s*m/s)", R"(\S+)"};
  return number_patterns.at(static_cast<std::size_t>(takes));
}

std::string pattern_of(const RuleKind& kind) {
  std::vector<std::string> parts;
  for (const std::string_view word : words_of(kind.form))
    parts.push_back(word == "{}" ? pattern_of(kind.takes) : std::string(word));
  return fmt::format(R"(^\s*{}\s*$)", fmt::join(parts, R"(\s+)"));
}

Json schema_of_faults() {
  Json kinds = Json::array(), examples = Json::array();
  for (const FaultKind* kind : fault_kinds()) {
    const KindModes modes = modes_of(*kind);
    const bool anywhere =
        !modes.sitl.possible.empty() || !modes.fabric.possible.empty() || !modes.embedded.possible.empty();
    if (!anywhere) continue;  // rows that only say why there is no such fault
    kinds.push_back(
        {{"pattern", pattern_of(*kind)}, {"description", fmt::format("{} ({})", kind->form, modes_text(modes))}});
    examples.push_back(examples_of(*kind).front());
  }
  return {{"anyOf", kinds}, {"examples", examples}};
}

Json schema_of_rules() {
  Json kinds = Json::array();
  for (const RuleKind& kind : rule_kinds())
    kinds.push_back({{"pattern", pattern_of(kind)}, {"description", fmt::format("{}: {}", kind.form, kind.help)}});
  return {{"type", "string"}, {"anyOf", kinds}};
}

/// Of one key, as the reader asked for it.
Json property_of(const KeyDescription& key) {
  Json property = Json::object();
  const bool whole = key.type == "whole number";
  if (!key.about.empty()) property["description"] = key.about;
  if (key.type == "text") {
    property["type"] = "string";
    if (!key.choices.empty()) property["enum"] = key.choices;
    if (!key.pattern.empty()) property["pattern"] = key.pattern;
  } else if (key.type == "true or false") {
    property["type"] = "boolean";
  } else if (key.type == "number" || whole) {
    property["type"] = whole ? "integer" : "number";
    if (key.min) property["minimum"] = whole ? Json(static_cast<std::int64_t>(*key.min)) : Json(*key.min);
    if (key.max) property["maximum"] = whole ? Json(static_cast<std::int64_t>(*key.max)) : Json(*key.max);
  } else if (key.type == "texts") {
    property["type"] = "array";
    property["items"] = {{"type", "string"}};
    if (key.max) property["maxItems"] = static_cast<std::int64_t>(*key.max);
  }
  return property;
}

/// What the tables of faults, moments and rules say of a key, besides.
void refine(const KeyDescription& key, Json& property) {
  if (key.key == "must" && key.table.empty()) property["items"] = schema_of_rules();
  if (key.table != "[[fault]]" && key.table != "[[pilot]]") return;
  if (key.key == "what") property.update(schema_of_faults());
  if (key.key == "at") property["pattern"] = moment_pattern;
  if (key.key == "for") property["pattern"] = duration_pattern;
}

Json empty_table() {
  return {
      {"type", "object"}, {"additionalProperties", false}, {"properties", Json::object()}, {"required", Json::array()}};
}

}  // namespace

std::string script_schema() {
  Config config = Config::describing();
  (void)read_script(config, "");
  Json root = empty_table();
  Json tables = Json::object();
  for (const KeyDescription& key : config.described()) {
    if (!key.table.empty() && !tables.contains(key.table)) tables[key.table] = empty_table();
    Json& table = key.table.empty() ? root : tables[key.table];
    if (key.key.empty()) {
      if (!key.about.empty()) table["description"] = key.about;
      continue;
    }
    Json property = property_of(key);
    refine(key, property);
    table["properties"][key.key] = std::move(property);
    if (key.usual.empty()) table["required"].push_back(key.key);
  }
  for (auto& [heading, table] : tables.items()) {
    const bool repeated = heading.starts_with("[[");
    const std::string name = heading.substr(repeated ? 2 : 1, heading.find(']') - (repeated ? 2 : 1));
    root["properties"][name] = repeated ? Json{{"type", "array"}, {"items", table}} : table;
  }
  Json schema{{"$schema", "http://json-schema.org/draft-07/schema#"},
              {"title", "A fault script of Ledgerline"},
              {"description", "One flight, what goes wrong in it, and what must hold: docs/faults.md"}};
  schema.update(root);
  return schema.dump(2) + "\n";
}

}  // namespace ledgerline::hil
