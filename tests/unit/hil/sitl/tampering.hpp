#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "hil/fault/run/run.hpp"
#include "tests/unit/campaign.hpp"

/// For campaigns of flights in which somebody lies.
namespace ledgerline::hil {

/// Flies a script, and expects all that must hold. `name`: for errors.
inline void expect_held(const std::string& text, const std::string& name, std::uint64_t seed) {
  SCOPED_TRACE(name + ", seed " + std::to_string(seed));
  const auto script = parse_script(text, name);
  ASSERT_TRUE(script) << script.error().message;
  const auto result = run_script(*script, seed);
  ASSERT_TRUE(result) << result.error().message;
  for (const Verdict& verdict : result->verdicts)
    EXPECT_TRUE(verdict.held) << verdict.rule.text << ": " << verdict.what;
}

/// All of them; with sanitizers one of eight.
inline std::vector<std::string> some_of(const std::vector<std::string>& tamperings) {
  std::vector<std::string> some;
  for (std::size_t i = 0; i < tamperings.size(); i += slow ? 8 : 1) some.push_back(tamperings[i]);
  return some;
}

/// As a test may be named.
inline std::string test_name(const testing::TestParamInfo<std::string>& tampering) {
  std::string name = tampering.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

}  // namespace ledgerline::hil
