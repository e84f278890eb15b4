#include "hil/fault/catalogue/schema.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <regex>

#include "hil/fault/catalogue/kind_modes.hpp"
#include "hil/fault/judge/rule.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

using nlohmann::json;

json schema() { return json::parse(script_schema()); }

bool matches(const json& any_of, const std::string& text) {
  return std::ranges::any_of(any_of, [&](const json& one) {
    return std::regex_search(text, std::regex(one.at("pattern").get<std::string>(), std::regex::ECMAScript));
  });
}

TEST(Schema, HasEveryKeyThatTheReaderAsksForWithItsTypeAndRange) {
  const json root = schema();
  EXPECT_EQ(root["required"], json::array({"title"}));
  EXPECT_EQ(root["additionalProperties"], false);
  for (const char* key : {"title", "seed", "must", "flight", "fault"})
    EXPECT_TRUE(root["properties"].contains(key)) << key;
  const json &flight = root["properties"]["flight"]["properties"], &fault = root["properties"]["fault"]["items"];
  EXPECT_GE(flight.size(), 19U);
  for (const auto& [key, property] : flight.items()) EXPECT_TRUE(property.contains("type")) << key;
  EXPECT_EQ(flight["laps"]["type"], "integer");
  EXPECT_EQ(flight["laps"]["maximum"], 100);
  EXPECT_EQ(flight["shape"]["enum"], json(motion::shape_names()));
  EXPECT_TRUE(flight["limit"].contains("pattern"));
  EXPECT_EQ(fault["required"], json::array({"what"}));
  EXPECT_EQ(fault["properties"]["optional"]["type"], "boolean");
}

TEST(Schema, TakesWhatTheTablesTakeAndNothingElse) {
  const json root = schema();
  const json &what = root["properties"]["fault"]["items"]["properties"]["what"]["anyOf"],
             &must = root["properties"]["must"]["items"]["anyOf"];
  for (const FaultKind* kind : fault_kinds()) {
    const KindModes modes = modes_of(*kind);
    for (const auto* mode : {&modes.in_virtual_time, &modes.embedded, &modes.fabric}) {
      for (const std::string& example : mode->possible) EXPECT_TRUE(matches(what, example)) << example;
    }
  }
  for (const char* wrong : {"drone tello1 sideways", "ledger", "clouds", "", "drone tello1 kick 1 2"})
    EXPECT_FALSE(matches(what, wrong)) << wrong;
  for (const RuleKind& kind : rule_kinds()) {
    std::string rule = form_of(kind);
    for (const auto& [open, word] : {std::pair("MODE|CAUSE", "plan ran out"), std::pair("COMMAND", "land")}) {
      if (const auto at = rule.find(open); at != std::string::npos) rule.replace(at, std::string(open).size(), word);
    }
    EXPECT_TRUE(parse_rule(rule).ok()) << rule;
    EXPECT_TRUE(matches(must, rule)) << rule;
  }
  for (const char* wrong : {"flies well", "lands within 5", "hold is", "sends rc"})
    EXPECT_FALSE(matches(must, wrong)) << wrong;
}

TEST(Schema, TakesTheFaultsMomentsAndRulesOfTheLibrary) {
  const json root = schema();
  const json& fault = root["properties"]["fault"]["items"]["properties"];
  const std::regex at(fault["at"]["pattern"].get<std::string>()), lasts(fault["for"]["pattern"].get<std::string>());
  for (const std::string& file : library()) {
    const auto script = load_script(file);
    ASSERT_TRUE(script.ok()) << script.error().what;
    for (const Fault& one : script->faults) {
      EXPECT_TRUE(matches(fault["what"]["anyOf"], one.text)) << file << ": " << one.text;
      EXPECT_TRUE(std::regex_search(one.at, at)) << file << ": " << one.at;
      if (one.for_ns == 0) continue;
      EXPECT_TRUE(std::regex_search(time_text(one.for_ns), lasts)) << file;
    }
    for (const Rule& rule : script->must)
      EXPECT_TRUE(matches(root["properties"]["must"]["items"]["anyOf"], rule.text)) << file;
  }
  for (const char* wrong : {"noon", "5", "5s + 1s", "path + soon", "lap"})
    EXPECT_FALSE(std::regex_search(wrong, at)) << wrong;
}

}  // namespace
}  // namespace ledgerline::hil
