#include "common/config/config.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

namespace ledgerline {
namespace {

Config config_of(const std::string& text) { return Config::parse(text, "link.toml").value(); }
std::string problems(Config& config) {
  const auto status = config.finish();
  return status ? "" : status.error().message;
}

TEST(Config, GivesWhatIsThereAndDefaultsForTheRest) {
  auto config = config_of(R"(
name = "a"
words = ["a", "b c"]
[state]
rate_hz = 50
fast = true
[fence]
box = [-1, 2.5, 3.0]
)");
  EXPECT_EQ(config.text("name"), "a");
  EXPECT_EQ(config.text("state.missing", "b"), "b");
  EXPECT_EQ(config.number("state.rate_hz", 30.0, 1, 200), 50.0);  // whole numbers are numbers
  EXPECT_EQ(config.number("state.rate_hz", 1, 200), 50.0);
  EXPECT_EQ(config.number("state.other_hz", 30.0, 1, 200), 30.0);
  EXPECT_EQ(config.integer("state.rate_hz", 1, 1, 200), 50);
  EXPECT_TRUE(config.boolean("state.fast", false));
  EXPECT_EQ(config.numbers("fence.box", 3, {}), (std::vector<double>{-1, 2.5, 3}));
  EXPECT_EQ(config.texts("words", 3), (std::vector<std::string>{"a", "b c"}));
  EXPECT_TRUE(config.texts("no.words", 3).empty());
  EXPECT_EQ(config.choice("shape", {"square", "x"}, "square"), "square");
  EXPECT_EQ(problems(config), "");
}

TEST(Config, AProblemIsReportedOnceHoweverOftenItIsFound) {
  auto config = config_of("other = 1\n");
  const std::string once = problems(config);
  EXPECT_EQ(problems(config), once);
}

TEST(Config, TablesAreCountedAndIndexed) {
  auto config = config_of("[[drone]]\nname = \"tello1\"\n[[drone]]\nname = \"tello2\"\n");
  ASSERT_EQ(config.table_count("drone"), 2U);
  EXPECT_EQ(config.text("drone.0.name"), "tello1");
  EXPECT_EQ(config.text("drone.1.name"), "tello2");
  EXPECT_EQ(config.table_count("msp"), 0U);
  EXPECT_EQ(problems(config), "");
}

TEST(Config, ErrorsNameFileLineAndKey) {
  auto config = config_of(
      "[state]\nrate_hz = 500\nname = 3\nfast = \"yes\"\ncount = 1.5\nbox = [1]\nshape = \"ring\"\ndrone = 1\n");
  (void)config.number("state.rate_hz", 30.0, 1, 200);
  (void)config.text("state.name", "");
  (void)config.boolean("state.fast", false);
  (void)config.integer("state.count", 1, 0, 9);
  (void)config.numbers("state.box", 2, {});
  (void)config.choice("state.shape", {"square", "x"}, "square");
  (void)config.table_count("state.drone");
  const std::string what = problems(config);
  for (const char* wanted :
       {"link.toml:2: state.rate_hz: must be a number from 1 to 200", "link.toml:3: state.name: must be a string",
        "link.toml:4: state.fast: must be true or false",
        "link.toml:5: state.count: must be a whole number from 0 to 9", "link.toml:6: state.box: must be 2 numbers",
        "link.toml:7: state.shape: is \"ring\", must be one of square, x",
        "link.toml:8: state.drone: must be tables"}) {
    EXPECT_NE(what.find(wanted), std::string::npos) << wanted << "\nin\n" << what;
  }
}

TEST(Config, AMissingKeyWithoutADefaultIsAnError) {
  auto config = config_of("");
  EXPECT_EQ(config.text("ledger.endpoint"), "");
  (void)config.number("state.rate_hz", 1, 200);
  const std::string what = problems(config);
  EXPECT_NE(what.find("link.toml: ledger.endpoint: is missing"), std::string::npos) << what;
  EXPECT_NE(what.find("state.rate_hz: is missing (a number from 1 to 200)"), std::string::npos) << what;
}

TEST(Config, AKeyThatNobodyAskedForIsAnErrorWithItsLine) {
  auto config = config_of(
      "name = \"a\"\n[state]\nrate_hz = 30\nrate_hertz = 30\n[[drone]]\nname = \"x\"\nadress = \"y\"\n[empty]\n");
  (void)config.text("name");
  (void)config.number("state.rate_hz", 30.0, 1, 200);
  (void)config.table_count("drone");
  (void)config.text("drone.0.name");
  (void)config.text("drone.0.address", "");
  const std::string what = problems(config);
  EXPECT_TRUE(what.ends_with("link.toml:4: state.rate_hertz: unknown key")) << what;
  EXPECT_NE(what.find("link.toml:7: drone.0.adress: unknown key: did you mean address?"), std::string::npos) << what;
  EXPECT_EQ(what.find("rate_hz:"), std::string::npos) << what;
}

TEST(Config, AKeyOfTheReleaseBeforeIsRefusedWithItsNewName) {
  auto config = config_of("[ledger]\npatience = \"auto\"\n");
  EXPECT_EQ(problems(config), "link.toml:2: ledger.patience: is ledger.timeouts now");
}

TEST(Config, NotANumberIsNoNumberInRange) {
  auto config = config_of("a = nan\nb = inf\n");
  EXPECT_EQ(config.number("a", 1.0, 0, 2), 1.0);
  EXPECT_EQ(config.number("b", 1.0, 0, 2), 1.0);
  EXPECT_NE(problems(config), "");
}

TEST(Config, ATextIsOneLineWithoutControlCharacters) {
  auto config = config_of("a = \"x\\u0000y\"\nb = \"\"\"two\nlines\"\"\"\nc = \"caf\u00e9\"\n");
  EXPECT_EQ(config.text("a", "other"), "other");
  EXPECT_EQ(config.text("b", "other"), "other");
  EXPECT_EQ(config.text("c"), "caf\u00e9");
  const std::string what = problems(config);
  EXPECT_NE(what.find("link.toml:1: a: must be one line"), std::string::npos) << what;
  EXPECT_NE(what.find("link.toml:2: b: must be one line"), std::string::npos) << what;
}

TEST(Config, NumbersOfAListMustBeFinite) {
  for (const char* list : {"a = [nan, 1.0]\n", "a = [1.0, inf]\n", "a = [-inf, 1.0]\n"}) {
    auto config = config_of(list);
    EXPECT_EQ(config.numbers("a", 2, {3, 4}), (std::vector<double>{3, 4})) << list;
    EXPECT_NE(problems(config), "") << list;
  }
}

TEST(Config, AListOfTextsHoldsLinesAndNotTooMany) {
  for (const char* list : {"a = [1]\n", "a = \"x\"\n", "a = [\"x\", \"y\\n\"]\n", "a = [\"x\", \"y\", \"z\"]\n"}) {
    auto config = config_of(list);
    EXPECT_TRUE(config.texts("a", 2).empty()) << list;
    EXPECT_NE(problems(config).find("link.toml:1: a: must be a list of at most 2 texts"), std::string::npos) << list;
  }
}

TEST(Config, AKeyOfADamagedFileIsShownAsAPersonCanReadIt) {
  auto config = config_of("\"a\\u001b[2J" + std::string(5'000, 'x') + "\" = 1\n");
  const std::string what = problems(config);
  EXPECT_NE(what.find("a?[2Jxxx"), std::string::npos) << what;
  EXPECT_LT(what.size(), 400U);
}

TEST(Config, ATableForAnotherProgramMeansTheSameThere) {
  auto config =
      config_of("[a]\nx = 1\nlist = [1, 2.5]\n[a.inner]\ntext = \"y\"\n[[b]]\nz = 3\n[[b]]\nz = 4\n[c]\nw = 5\n");
  const std::string text = config.table_text("a") + config.table_text("b") + config.table_text("none");
  config.skip_table("a");
  config.skip_table("b");
  EXPECT_EQ(problems(config), "link.toml:11: c.w: unknown key");
  auto other = config_of(text);
  EXPECT_EQ(other.integer("a.x", 0, 0, 9), 1);
  EXPECT_EQ(other.numbers("a.list", 2, {}), (std::vector<double>{1, 2.5}));
  EXPECT_EQ(other.text("a.inner.text"), "y");
  EXPECT_EQ(other.table_count("b"), 2U);
  EXPECT_EQ(other.integer("b.0.z", 0, 0, 9), 3);
  EXPECT_EQ(other.integer("b.1.z", 0, 0, 9), 4);
  EXPECT_EQ(problems(other), "");
}

TEST(Config, SyntaxErrorsHaveTheLineToo) {
  auto config = Config::parse("a = 1\nb = = 2\n", "link.toml");
  ASSERT_FALSE(config);
  EXPECT_EQ(config.error().message.find("link.toml:2: "), 0U) << config.error().message;
}

TEST(Config, FilesAreReadAndMissingOnesNamed) {
  const std::string path = testing::TempDir() + "config" + std::to_string(::getpid()) + ".toml";
  std::ofstream(path) << "a = 1\nb = 2\n";
  {
    auto config = Config::load(path).value();
    EXPECT_EQ(config.integer("a", 0, 0, 9), 1);
    EXPECT_NE(problems(config).find(path + ":2: b: unknown key"), std::string::npos);
  }
  std::filesystem::remove(path);
  auto gone = Config::load(path);
  ASSERT_FALSE(gone);
  EXPECT_EQ(gone.error().message, path + ": No such file or directory");
}

TEST(Config, ADescribingOneListsWhatWasAskedForOnceInTheReadersOrder) {
  Config config = Config::describing();
  EXPECT_TRUE(config.is_describing());
  (void)config.text("name");
  (void)config.number({"state.rate_hz", "samples a second"}, 30.0, 1, 200);
  (void)config.choice("state.shape", {"square", "x"}, "square");
  ASSERT_EQ(config.table_count({"drone", "one each"}), 1U);
  (void)config.integer({"drone.0.number", "in shared memory", "its place"}, 1, 1, 16);
  (void)config.number("state.rate_hz", 1, 200);
  const auto keys = config.described();
  ASSERT_EQ(keys.size(), 5U);
  EXPECT_EQ(keys[0].table + keys[0].key, "name");
  EXPECT_EQ(keys[0].usual, "");  // must be there
  EXPECT_EQ(keys[1].table, "[state]");
  EXPECT_EQ(keys[1].key, "rate_hz");
  EXPECT_EQ(keys[1].type, "number");
  EXPECT_EQ(keys[1].unit, "Hz");
  EXPECT_EQ(keys[1].usual, "30");
  EXPECT_EQ(keys[1].allowed, "1 to 200");
  EXPECT_EQ(keys[1].about, "samples a second");
  EXPECT_EQ(keys[2].allowed, "square, x");
  EXPECT_EQ(keys[3].table, "[[drone]]");
  EXPECT_EQ(keys[3].key, "");
  EXPECT_EQ(keys[4].table, "[[drone]]");
  EXPECT_EQ(keys[4].usual, "its place");
  EXPECT_FALSE(config.finish());  // keys without a default are missing
  EXPECT_FALSE(Config::parse("", "").value().is_describing());
}

}  // namespace
}  // namespace ledgerline
