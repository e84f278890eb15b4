#include "hil/fault/compare/comparison.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "hil/fault/report.hpp"

namespace ledgerline::hil::comparing {
namespace {

using testing::HasSubstr;

RunResult result_of(const std::string& script, std::uint64_t seed, bool held) {
  RunResult result;
  result.script = script;
  result.seed = seed;
  result.digest[0] = static_cast<unsigned char>(seed);
  Rule rule;
  rule.text = "finishes";
  result.verdicts.push_back({rule, held, 0, ""});
  result.metrics = {{"path_rms_m", 0.1234567890123}, {"holds", 1}};
  return result;
}

TEST(ResultsFile, HasEveryRunThatWasFlownNotOnlyThoseInFull) {
  std::vector<RunSummary> all;
  for (std::uint64_t seed = 1; seed <= 300; ++seed)
    all.push_back(hil::summary_of(result_of("a", seed, seed != 7), "text"));
  const auto runs = parse_results(hil::json_text({result_of("a", 1, true)}, all), "r.json");
  ASSERT_TRUE(runs.ok()) << runs.error().message;
  ASSERT_EQ(runs->runs.size(), 300U);
  const FlownRun& run = runs->runs[6];
  EXPECT_EQ(run.script, "a");
  EXPECT_EQ(run.seed, 7U);
  EXPECT_EQ(run.source, "text");
  EXPECT_EQ(run.digest.substr(0, 4), "0700");
  EXPECT_EQ(run.broken, std::vector<std::string>{"finishes"});
  EXPECT_EQ(run.metrics.at("path_rms_m"), 0.1234567890123) << "to the last bit";
  EXPECT_TRUE(runs->runs[0].broken.empty());
}

TEST(ResultsFile, JUnitHasATestCaseOfEveryRunToo) {
  const RunResult held = result_of("a", 1, true), broken = result_of("a", 2, false),
                  left_out = result_of("a", 3, false);
  const std::string junit = junit_text(
      {held, broken}, {hil::summary_of(held, ""), hil::summary_of(broken, ""), hil::summary_of(left_out, "")});
  EXPECT_THAT(junit, HasSubstr("tests=\"3\" failures=\"2\""));
  EXPECT_THAT(junit, HasSubstr("broke at 0.000 s: finishes"));
  EXPECT_THAT(junit, HasSubstr("name=\"seed 3\" time=\"0.000\">\n    <failure message=\"a\">finishes</failure>"));
}

TEST(ResultsFile, WhatWasNotFlownIsInBothFilesAndIsNoRun) {
  const RunResult held = result_of("a", 1, true);
  const std::vector<NotFlown> missing{{"a", 2, "no \"room\""}, {"b", std::nullopt, "real time alone", false}};
  const std::string junit = junit_text({held}, {hil::summary_of(held, "")}, missing);
  EXPECT_THAT(junit, HasSubstr("tests=\"3\" failures=\"0\" errors=\"1\" skipped=\"1\""));
  EXPECT_THAT(junit, HasSubstr("classname=\"a\" name=\"seed 2\">\n    <error message=\"no &quot;room&quot;\"/>"));
  EXPECT_THAT(junit, HasSubstr("classname=\"b\" name=\"not flown\">\n    <skipped message=\"real time alone\"/>"));
  const std::string text = hil::json_text({held}, {hil::summary_of(held, "")}, missing);
  const auto all = nlohmann::json::parse(text);
  EXPECT_FALSE(all["held"]);
  EXPECT_EQ(all["not_flown"][0],
            (nlohmann::json{{"script", "a"}, {"seed", 2}, {"error", true}, {"why", "no \"room\""}}));
  EXPECT_EQ(all["not_flown"][1], (nlohmann::json{{"script", "b"}, {"error", false}, {"why", "real time alone"}}));
  EXPECT_EQ(parse_results(text, "r.json")->runs.size(), 1U);
  EXPECT_TRUE(nlohmann::json::parse(hil::json_text({held}, {hil::summary_of(held, "")}, {missing[1]}))["held"]);
  EXPECT_FALSE(all["interrupted"]);
  const NotFlown rest{.script = "the rest", .why = "interrupted: 1 of 2 runs flown", .interrupted = true};
  const auto interrupted = nlohmann::json::parse(hil::json_text({held}, {hil::summary_of(held, "")}, {rest}));
  EXPECT_TRUE(interrupted["interrupted"]);
  EXPECT_FALSE(interrupted["held"]) << "of what was not flown nobody knows";
  EXPECT_THAT(html_text({held}, {hil::summary_of(held, "")}, {rest}), HasSubstr("interrupted: 1 of 2 runs flown"));
}

TEST(ResultsFile, CountsByRuleAndHasALineOfCsvForEachRun) {
  const std::vector<RunSummary> all{hil::summary_of(result_of("a", 1, false), ""),
                                    hil::summary_of(result_of("a", 2, false), ""),
                                    hil::summary_of(result_of("b", 1, true), "")};
  EXPECT_EQ(by_rule_text(all), "  2 runs of 1 script broke: finishes\n");
  EXPECT_EQ(by_rule_text({all[2]}), "");
  const std::string csv = csv_text(all);
  EXPECT_THAT(csv, testing::StartsWith("script,seed,mode,held,flown_s,broken,"));
  EXPECT_THAT(csv, HasSubstr("\n\"a\",2,,false,0.000,\"finishes\","));
  EXPECT_THAT(csv, HasSubstr("\n\"b\",1,,true,0.000,\"\","));
  EXPECT_THAT(csv, HasSubstr(",0.1234567890123,"));
  EXPECT_EQ(std::ranges::count(csv, '\n'), 4);
  const std::string header = csv.substr(0, csv.find('\n'));
  EXPECT_EQ(header.find("flown_s"), header.rfind("flown_s")) << "one column of each name";
  EXPECT_THAT(html_text({}, all), HasSubstr("\"scripts\":1"));
}

TEST(ResultsFile, SaysHowEachRunWasFlown) {
  RunSummary flown = hil::summary_of(result_of("a", 1, true), "");
  flown.mode = "real-fabric";
  EXPECT_EQ(parse_results(hil::json_text({}, {flown}), "r.json")->runs[0].mode, "real-fabric");
}

TEST(ResultsFile, OfRealProcessesPromisesNoBytes) {
  RunResult real = result_of("a", 1, true);
  real.digest = {};
  const auto runs = parse_results(hil::json_text({real}, {hil::summary_of(real, "")}), "r.json");
  ASSERT_TRUE(runs.ok());
  EXPECT_EQ(runs->runs[0].digest, "");
}

TEST(ResultsFile, SaysWhatIsWrongWithWhichRun) {
  const auto error_of = [](const std::string& text) {
    const auto runs = parse_results(text, "r.json");
    return runs ? "" : runs.error().message;
  };
  const std::string good = R"({"script": "a", "seed": 1, "broken": [], "figures": {"holds": 1}})";
  EXPECT_EQ(error_of(R"({"figures": [)" + good + "]}"), "");
  const std::pair<std::string, const char*> cases[] = {
      {"", "r.json: is no JSON object"},
      {"[1]", "r.json: is no JSON object"},
      {R"({"runs": []})", "r.json: figures: must be a list of runs"},
      {R"({"figures": []})", "r.json: figures: must be a list of runs"},
      {R"({"figures": [1]})", "r.json: figures.0: must be an object"},
      {R"({"figures": [)" + good + R"(, {"seed": 1}]})", "r.json: figures.1: script is missing"},
      {R"({"figures": [{"script": "a", "seed": -1}]})", "figures.0: seed must be a whole number"},
      {R"({"figures": [{"script": "a", "seed": 1}]})", "figures.0: broken must be a list of rules"},
      {R"({"figures": [{"script": "a", "seed": 1, "broken": [2]}]})", "figures.0: broken must be a list of rules"},
      {R"({"figures": [{"script": "a", "seed": 1, "broken": []}]})", "figures.0: figures must be an object"},
      {R"({"figures": [{"script": "a", "seed": 1, "broken": [], "figures": {"holds": "1"}}]})",
       "figures.0: figures.holds must be a number"},
      {R"({"figures": [{"script": "a", "seed": 1, "digest": 1, "broken": [], "figures": {}}]})",
       "figures.0: digest must be a text"},
      {R"({"figures": [)" + good + "," + good + "]}", "figures.1: a seed 1 is there twice"},
  };
  for (const auto& [text, wanted] : cases) EXPECT_THAT(error_of(text), HasSubstr(wanted)) << text;
  EXPECT_THAT(read_results("/nowhere/r.json").error().message, HasSubstr("/nowhere/r.json"));
}

}  // namespace
}  // namespace ledgerline::hil::comparing
