#include "hil/fault/kinds/fault.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <regex>

#include "hil/fault/checker/rule.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

using nlohmann::json;

json schema() { return json::parse(script_schema()); }

/// The patterns of an anyOf, compiled once.
class Patterns {
 public:
  explicit Patterns(const json& any_of) {
    for (const json& one : any_of) patterns_.emplace_back(one.at("pattern").get<std::string>());
  }
  bool match(const std::string& text) const {
    return std::ranges::any_of(patterns_, [&](const std::regex& one) { return std::regex_search(text, one); });
  }

 private:
  std::vector<std::regex> patterns_;
};

TEST(Schema, HasEveryKeyThatTheReaderAsksForWithItsTypeAndRange) {
  const json root = schema();
  EXPECT_EQ(root["required"], json::array({"title"}));
  EXPECT_EQ(root["additionalProperties"], false);
  for (const char* key : {"title", "seed", "must", "flight", "fault"})
    EXPECT_TRUE(root["properties"].contains(key)) << key;
  const json &flight = root["properties"]["flight"]["properties"], &fault = root["properties"]["fault"]["items"];
  EXPECT_GE(flight.size(), 19U);
  for (const json* table : {&root["properties"], &flight, &fault["properties"]}) {
    for (const auto& [key, property] : table->items()) {
      EXPECT_TRUE(property.contains("type")) << key;
      const bool sent =
          property.contains("description") || (property.contains("items") && property["items"].contains("description"));
      EXPECT_TRUE(sent || key == "flight") << key << ": its reader says what it is";
    }
  }
  EXPECT_EQ(flight["laps"]["type"], "integer");
  EXPECT_EQ(flight["laps"]["maximum"], 100);
  EXPECT_EQ(flight["kind"]["enum"], json::array({"path", "manual", "sdk"}));
  const std::regex shape(flight["shape"]["pattern"].get<std::string>());
  for (const std::string& name : ground::motion::shape_names()) EXPECT_TRUE(std::regex_match(name, shape)) << name;
  EXPECT_TRUE(std::regex_match("way.csv", shape));
  EXPECT_FALSE(std::regex_match("circle", shape));
  EXPECT_EQ(root["properties"]["task"]["items"]["required"], json::array({"drone"}));
  EXPECT_EQ(root["properties"]["pilot"]["items"]["required"], json::array({"do"}));
  EXPECT_EQ(flight["on_untrusted_ledger"]["enum"], json::array({"ignore", "hold", "land"}));
  EXPECT_TRUE(flight["limit"].contains("pattern"));
  EXPECT_EQ(fault["required"], json::array({"what"}));
  EXPECT_EQ(fault["properties"]["optional"]["type"], "boolean");
}

TEST(Schema, TakesWhatTheTablesTakeAndNothingElse) {
  const json root = schema();
  const Patterns what(root["properties"]["fault"]["items"]["properties"]["what"]["anyOf"]),
      must(root["properties"]["must"]["items"]["anyOf"]);
  for (const FaultKind* kind : fault_kinds()) {
    const KindModes modes = modes_of(*kind);
    for (const auto* mode : {&modes.sitl, &modes.embedded, &modes.fabric}) {
      for (const std::string& example : mode->possible) EXPECT_TRUE(what.match(example)) << example;
    }
  }
  for (const char* wrong : {"drone tello1 sideways", "ledger", "clouds", "", "drone tello1 kick 1 2"})
    EXPECT_FALSE(what.match(wrong)) << wrong;
  for (const RuleKind& kind : rule_kinds()) {
    std::string rule = form_of(kind);
    for (const auto& [open, word] : {std::pair("MODE|CAUSE", "plan ran out"), std::pair("COMMAND", "land")}) {
      if (const auto at = rule.find(open); at != std::string::npos) rule.replace(at, std::string(open).size(), word);
    }
    EXPECT_TRUE(parse_rule(rule).ok()) << rule;
    EXPECT_TRUE(must.match(rule)) << rule;
  }
  for (const char* wrong : {"flies well", "lands within 5", "hold is", "sends rc"})
    EXPECT_FALSE(must.match(wrong)) << wrong;
}

TEST(Schema, TakesTheFaultsMomentsAndRulesOfTheLibrary) {
  const json root = schema();
  const json& fault = root["properties"]["fault"]["items"]["properties"];
  const std::regex at(fault["at"]["pattern"].get<std::string>()), lasts(fault["for"]["pattern"].get<std::string>());
  const Patterns what(fault["what"]["anyOf"]), must(root["properties"]["must"]["items"]["anyOf"]);
  for (const std::string& file : library()) {
    const auto script = load_script(file);
    ASSERT_TRUE(script.ok()) << script.error().message;
    for (const Fault& one : script->faults) {
      EXPECT_TRUE(what.match(one.text)) << file << ": " << one.text;
      EXPECT_TRUE(std::regex_search(one.at, at)) << file << ": " << one.at;
      if (one.for_ns == 0) continue;
      EXPECT_TRUE(std::regex_search(time_text(one.for_ns), lasts)) << file;
    }
    for (const Rule& rule : script->must) EXPECT_TRUE(must.match(rule.text)) << file;
  }
  for (const char* wrong : {"noon", "5", "5s + 1s", "path + soon", "lap"})
    EXPECT_FALSE(std::regex_search(wrong, at)) << wrong;
}

}  // namespace
}  // namespace ledgerline::hil
