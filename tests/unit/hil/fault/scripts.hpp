#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "hil/fault/script.hpp"

// Scripts for tests: those of the library, and such as a test writes itself.
namespace ledgerline::hil {

inline std::vector<std::string> library() {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(SCENARIOS)) {
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

inline std::string error_of(const std::string& toml) {
  const auto script = parse_script(toml, "x.toml");
  return script ? "" : script.error().message;
}

inline Script scripted(const std::string& toml) {
  auto script = parse_script(toml, "x.toml");
  EXPECT_TRUE(script.ok()) << script.error().message;
  return *script;
}

}  // namespace ledgerline::hil
