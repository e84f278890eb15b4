#include "common/program/command_line.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "common/base/nearest_word.hpp"
#include "common/program/program.hpp"

namespace ledgerline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

struct Values {
  int laps = 3;
  double speed = 0.5;
  bool quiet = false, shrinks = true;
  std::string mode = "on", time;
  std::vector<std::string> names;
  std::vector<int> domains;
};

/// A program with an option of each kind.
class ACommandLine : public testing::Test {
 protected:
  ACommandLine() {
    laps = line.option("--laps", values.laps, "How many").within(1, 9).shows_default();
    line.option("--speed", values.speed, "m/s").within(0.1, 5.0).excludes(laps);
    quiet = line.flag("--quiet", values.quiet, "Say less");
    line.flag("!--no-shrink", values.shrinks, "Leave it");
    line.option("--mode", values.mode, "Which").one_of({"on", "off"}).needs(quiet);
    line.option("--time", values.time, "When").checked_by("TIME", [](const std::string& text) {
      return text == "noon" ? "" : "not noon";
    });
    line.option("--domains", values.domains, "Two").comma_list(2);
    line.option("NAME", values.names, "Of drones");
  }
  std::string refusal(const std::vector<std::string>& arguments) {
    const auto end = line.read(arguments);
    EXPECT_TRUE(end && end->exit_code == exit_usage);
    return end ? end->text : "";
  }

  Values values;
  CommandLine line{"ledgerline fly", "Flies.", "Exit codes: 0"};
  Option laps{nullptr}, quiet{nullptr};
};

TEST_F(ACommandLine, WhatFewNeedIsInHelpAllAloneAndKeepsItsNameInErrors) {
  int depth = 0;
  line.option("--depth", depth, "Rarely asked for").within(1, 9).in_help_all();
  EXPECT_THAT(refusal({"--depth", "12"}), HasSubstr("--depth: Value 12 not in range"));
  const auto all = line.read({"--help-all"});
  ASSERT_TRUE(all);
  EXPECT_THAT(all->text, HasSubstr("--depth"));
  const auto help = line.read({"--help"});
  ASSERT_TRUE(help && help->exit_code == 0);
  EXPECT_THAT(help->text, testing::AllOf(HasSubstr("--laps"), testing::Not(HasSubstr("--depth")),
                                         HasSubstr("More options: ledgerline fly --help-all")));
}

TEST_F(ACommandLine, AWordThatIsNearlyRightIsAnsweredWithWhatWasMeant) {
  EXPECT_THAT(refusal({"--lapz", "3"}), HasSubstr("did you mean --laps?"));
  EXPECT_THAT(refusal({"--lip"}), testing::Not(HasSubstr("did you mean"))) << "two letters of three differ";
  EXPECT_THAT(refusal({"--xyzzy"}), testing::Not(HasSubstr("did you mean")));
  EXPECT_EQ(nearest_word("stpo", {"start", "stop"}), "stop");
  EXPECT_EQ(nearest_word("x", {"go"}), "") << "nothing is near a single character";
  EXPECT_EQ(nearest_word(std::string(1'000'000, 'x'), {"stop"}), "") << "bounded";
}

TEST_F(ACommandLine, NothingGivenLeavesTheDefaults) {
  EXPECT_FALSE(line.read({}));
  EXPECT_EQ(values.laps, 3);
  EXPECT_FALSE(laps.is_given());
  EXPECT_FALSE(line.is_given("--quiet"));
}

TEST_F(ACommandLine, EveryKindOfValueIsTaken) {
  const auto end = line.read({"tello1", "tello2", "--laps", "7", "--quiet", "--mode", "off", "--no-shrink", "--time",
                              "noon", "--domains", "1,2"});
  ASSERT_FALSE(end) << end->text;
  EXPECT_EQ(values.laps, 7);
  EXPECT_TRUE(values.quiet && !values.shrinks);
  EXPECT_EQ(values.mode, "off");
  EXPECT_EQ(values.time, "noon");
  EXPECT_THAT(values.domains, ElementsAre(1, 2));
  EXPECT_THAT(values.names, ElementsAre("tello1", "tello2"));
  EXPECT_TRUE(laps.is_given() && line.is_given("--quiet"));
}

TEST_F(ACommandLine, WhatCannotBeIsRefusedByTheOptionsName) {
  EXPECT_THAT(refusal({"--laps", "10"}), HasSubstr("--laps"));
  EXPECT_THAT(refusal({"--laps", "two"}), HasSubstr("--laps"));
  EXPECT_THAT(refusal({"--laps", "2", "--speed", "1"}), HasSubstr("--speed"));
  EXPECT_THAT(refusal({"--mode", "off"}), HasSubstr("--quiet"));
  EXPECT_THAT(refusal({"--quiet", "--mode", "maybe"}), HasSubstr("--mode"));
  EXPECT_THAT(refusal({"--time", "midnight"}), HasSubstr("not noon"));
  EXPECT_THAT(refusal({"--domains", "1"}), HasSubstr("--domains"));
  EXPECT_THAT(refusal({"--wings", "2"}), HasSubstr("--wings"));
}

TEST(AnOption, ThatAlsoStandsWithoutItsNameIsRequiredOnceInHelp) {
  std::string file;
  CommandLine line("local", "", "");
  line.option(config_argument, file, "TOML file").required();
  const std::string help = line.read({"--help"})->text;
  EXPECT_THAT(help, HasSubstr("CONFIG TEXT REQUIRED"));
  EXPECT_THAT(help, testing::ContainsRegex("--config TEXT or CONFIG +TOML file"));
  EXPECT_THAT(help, testing::Not(HasSubstr("--config TEXT REQUIRED")));
}

TEST_F(ACommandLine, UnexpectedWordsAreListedAsTheyWereTyped) {
  EXPECT_THAT(refusal({"--wings", "--wheels"}), HasSubstr("not expected: --wings --wheels\n"));
  line.verb("take", "Takes");
  EXPECT_THAT(refusal({"take", "one", "two"}), HasSubstr("not expected: one two\n"));
}

TEST_F(ACommandLine, HelpAndVersionAreNoErrors) {
  const auto help = line.read({"--help"});
  ASSERT_TRUE(help);
  EXPECT_EQ(help->exit_code, 0);
  for (const char* part : {"Flies.", "ledgerline fly", "--laps", "[1 - 9]", "Exit codes: 0", "--version"})
    EXPECT_THAT(help->text, HasSubstr(part));
  EXPECT_THAT(help->text, testing::AllOf(HasSubstr("--no-shrink "), testing::Not(HasSubstr("{false}"))));
  const auto version = line.read({"--version"});
  ASSERT_TRUE(version);
  EXPECT_EQ(version->exit_code, 0);
  EXPECT_EQ(version->text, version_line("ledgerline fly") + "\n");
}

TEST(AProgramWithVerbs, TakesOneOfThem) {
  CommandLine line("control", "", "");
  std::string file;
  const Verb take = line.verb("take", "Takes"), give = line.verb("give", "Gives");
  Verb(take).option("--file", file, "What").required();
  EXPECT_FALSE(line.read({"take", "--file", "a"}));
  EXPECT_TRUE(take.is_given() && !give.is_given());
  EXPECT_EQ(take.name(), "take");
  EXPECT_EQ(line.read({})->exit_code, exit_usage);
  EXPECT_THAT(line.read({})->text, HasSubstr("say what to do: take, give\n"));
  EXPECT_THAT(line.read({"tack", "--file", "a"})->text,
              testing::AllOf(HasSubstr("there is no \"tack\": take, give\n"), HasSubstr("did you mean take?")));
  EXPECT_EQ(line.read({"take"})->exit_code, exit_usage);
  EXPECT_THAT(line.read({"take"})->text, testing::Not(HasSubstr("there is no")));
  EXPECT_EQ(line.read({"--version"})->exit_code, 0);
}

TEST(AList, OfOneAtATimeTakesNoWordThatIsNotIts) {
  CommandLine line("fabric", "", "");
  std::vector<std::string> channels;
  line.option("--channel", channels, "Again for more").one_at_a_time();
  EXPECT_FALSE(line.read({"--channel", "teleop", "--channel", "yard"}));
  EXPECT_THAT(channels, ElementsAre("teleop", "yard"));
  EXPECT_EQ(line.read({"--channel", "teleop", "yard"})->exit_code, exit_usage);
}

TEST(ACommandLineWithVerbs, SaysWhatAWordMayBecome) {
  bool json = false, all = false;
  std::string file;
  std::vector<std::string> names;
  CommandLine line("drones", "", "");
  line.flag("--json", json, "");
  line.option("--token-file", file, "");
  Verb stop = line.verb("stop", "");
  stop.option("NAME", names, "");
  stop.flag("--all", all, "");
  line.verb("show", "");
  line.verbs_are_optional();
  const auto completed = [&](std::vector<std::string> words) {
    words.insert(words.begin(), completion_word);
    const auto end = line.read(words);
    EXPECT_TRUE(end && end->exit_code == 0);
    return end ? end->text : "";
  };
  EXPECT_EQ(completed({""}), "stop\nshow\n");
  EXPECT_EQ(completed({"st"}), "stop\n");
  EXPECT_EQ(completed({"--j"}), "--json\n");
  EXPECT_EQ(completed({"stop", ""}), "") << "a name is typed";
  EXPECT_EQ(completed({"stop", "tello1", "--a"}), "--all\n");
  EXPECT_EQ(completed({"stop", "--j"}), "--json\n") << "the program's own stand behind a verb, too";
  EXPECT_EQ(completed({"--token-file", "s"}), "") << "a value is typed";
  EXPECT_EQ(completed({"--json", "s"}), "stop\nshow\n") << "a flag has none";
  EXPECT_EQ(completed({}), "stop\nshow\n");
}

TEST(ACommandLineWithVerbs, NamesTheNewVerbInPlaceOfAnOldOne) {
  std::vector<std::string> names;
  CommandLine line("control", "", "");
  line.verb("clear_stop", "").option("NAME", names, "").required();
  line.renamed("resume", "clear_stop");
  const auto end = line.read({"resume", "tello1"});
  ASSERT_TRUE(end);
  EXPECT_EQ(end->exit_code, exit_usage);
  EXPECT_THAT(end->text, HasSubstr("resume is clear_stop now"));
  EXPECT_FALSE(line.read({"clear_stop", "resume"})) << "a drone's name";
}

TEST(ACommandLineWithVerbs, MayDoWithoutOne) {
  bool json = false;
  std::vector<std::string> names;
  CommandLine line("drones", "", "");
  line.flag("--json", json, "");
  Verb stop = line.verb("stop", "");
  stop.option("NAME", names, "").required();
  line.verbs_are_optional();
  EXPECT_FALSE(line.read({}));
  EXPECT_FALSE(stop.is_given());
  EXPECT_FALSE(line.read({"stop", "tello1", "--json"}));
  EXPECT_TRUE(stop.is_given() && json);
  EXPECT_THAT(line.read({"land"})->text, HasSubstr("there is no \"land\": stop\n"));
  EXPECT_THAT(line.read({"--wings"})->text, HasSubstr("not expected: --wings"));
}

TEST(AProgram, RefusesAPathThatConfigsCannotHoldByTheNameOfItsOption) {
  std::string out;
  CommandLine line("fly", "", "");
  line.option("--out", out, "").utf8_path();
  EXPECT_FALSE(line.read({"--out", "my \"new\" run\\caf\xc3\xa9"}));
  const auto end = line.read({"--out", "/tmp/caf\xe9"});
  ASSERT_TRUE(end);
  EXPECT_EQ(end->exit_code, exit_usage);
  EXPECT_THAT(end->text, HasSubstr("--out: /tmp/caf? is no UTF-8"));
}

// In a process of its own: its working folder goes.
void enter_a_folder_that_goes() {
  char folder[] = "/tmp/ledgerline-gone-XXXXXX";
  if (::mkdtemp(folder) == nullptr || ::chdir(folder) != 0 || ::rmdir(folder) != 0) std::_Exit(99);
}

TEST(AProgram, EndsWithAnErrorWhereItsWorkingFolderIsGone) {
  const auto run = [] {
    report_uncaught_file_errors();
    enter_a_folder_that_goes();
    []() noexcept { (void)std::filesystem::absolute("run1"); }();
  };
  EXPECT_EXIT(run(), testing::ExitedWithCode(exit_failed), "error: .*: No such file or directory");
}

TEST(AProgram, NamesTheOptionWhosePathCountsFromAWorkingFolderThatIsGone) {
  const auto run = [] {
    enter_a_folder_that_goes();
    std::fputs((utf8_path_problem("run1") + "|" + utf8_path_problem("/tmp/run1")).c_str(), stderr);
    std::_Exit(0);
  };
  EXPECT_EXIT(run(), testing::ExitedWithCode(0), "the working folder: No such file or directory\\|$");
}

TEST(AProgram, EndsWithAnErrorWhereItsOutputIsFull) {
  const auto run = [] {
    if (std::freopen("/dev/full", "w", stdout) == nullptr) std::_Exit(99);
    report_lost_output();
    print_line("a result");
    std::exit(0);
  };
  EXPECT_EXIT(run(), testing::ExitedWithCode(exit_failed), "error: standard output took less");
}

}  // namespace
}  // namespace ledgerline
