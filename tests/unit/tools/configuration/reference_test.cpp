#include "tools/configuration/config_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

namespace ledgerline::configuration {
namespace {

namespace fs = std::filesystem;

const fs::path source = LEDGERLINE_SOURCE;

std::string text_of(const fs::path& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

// Files whose Config is not a program's config: scripts of faults and of the shim's plans, the choice among [[msp]] of
// what was read before, and one that reads [ledger] alone and has a file's name among its defaults.
const std::set<std::string> other_readers{"tools/contract/main.cpp",     "hil/fault/script.cpp",
                                          "hil/fault/pilot.cpp",         "hil/fault/script.cpp",
                                          "hil/shim/scripted_agent.cpp", "onboard/agent/shell/main.cpp"};

const std::set<std::string> script_keys{"fault.do", "at_s", "for_s", "do"};  // of the proxy's scripts (docs/faults.md)

std::set<std::string> readers() {
  const std::regex asks(R"(config(\.|->)(text|choice|number|integer|boolean|numbers|texts|table_count)\()");
  std::set<std::string> files;
  for (const char* room : {"common", "chaincode", "onboard", "ground", "sim", "hil", "tools"}) {
    for (const auto& entry : fs::recursive_directory_iterator(source / room)) {
      const std::string name = fs::relative(entry.path(), source);
      if (entry.path().extension() != ".cpp" || name.starts_with("common/config/")) continue;
      if (std::regex_search(text_of(entry.path()), asks)) files.insert(name);
    }
  }
  return files;
}

/// "check.max_age_ms", "drone.name"; and each without its table.
std::set<std::string> described_keys() {
  std::set<std::string> keys;
  for (const Part& part : parts()) {
    for (const KeyDescription& key : part.keys) {
      std::string table = key.table;
      std::erase_if(table, [](char c) { return c == '[' || c == ']'; });
      keys.insert(key.key);
      keys.insert(table + "." + key.key);
      keys.insert(table);
    }
  }
  return keys;
}

TEST(Configuration, ThePageIsWhatTheReadersAskFor) {
  std::istringstream printed(page()), written(text_of(source / "docs/configuration.md"));
  for (std::string wanted, found; std::getline(printed, wanted);) {
    ASSERT_TRUE(std::getline(written, found)) << "docs/configuration.md ends before: " << wanted;
    ASSERT_EQ(found, wanted) << "print it again: ledgerline configuration > docs/configuration.md";
  }
  std::string more;
  EXPECT_FALSE(std::getline(written, more)) << "docs/configuration.md goes on: " << more;
}

TEST(Configuration, EveryKeySaysWhatItDoesAndMostWhatTheyAllow) {
  for (const Part& part : parts()) {
    for (const KeyDescription& key : part.keys) {
      EXPECT_FALSE(key.about.empty()) << part.name << " " << key.table << " " << key.key;
      EXPECT_TRUE(key.type.find("number") == std::string::npos || !key.allowed.empty()) << key.table << " " << key.key;
    }
  }
}

TEST(Configuration, TablesThatProgramsShareStandOnce) {
  for (const Part& part : parts()) {
    if (part.name == "The ledger" || part.name == "deployment") continue;
    for (const KeyDescription& key : part.keys) EXPECT_NE(key.table, "[ledger]") << part.name;
  }
}

// A key that a reader asks for under some condition only must be asked for in a description, too.
TEST(Configuration, NoReaderHasAKeyThatThePageLacks) {
  const std::set<std::string> keys = described_keys();
  const std::regex whole(R"re("([a-z_0-9]+(\.[a-z_0-9{}]+)+)")re"), below(R"re((?:at|key|table) \+ "(\w+)")re");
  std::set<std::string> seen;
  for (const std::string& file : readers()) {
    if (other_readers.contains(file)) continue;
    const std::string text = text_of(source / file);
    for (const auto& pattern : {whole, below}) {
      for (std::sregex_iterator match(text.begin(), text.end(), pattern), end; match != end; ++match) {
        std::string key = std::regex_replace((*match)[1].str(), std::regex(R"(\.\{\})"), "");
        if (key.find('.') != std::string::npos && std::isdigit(static_cast<unsigned char>(key[0])))
          continue;                             // an address
        if (key == "host.0.address") continue;  // in what a message says
        if (key.ends_with(".json") || key.ends_with(".crt") || key.ends_with(".pem")) continue;  // a file's name
        if (key.starts_with("{}") || script_keys.contains(key)) continue;
        EXPECT_TRUE(keys.contains(key)) << file << " reads " << key;
        seen.insert(key);
      }
    }
  }
  EXPECT_GT(seen.size(), 100U);
}

}  // namespace
}  // namespace ledgerline::configuration
