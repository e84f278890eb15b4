#pragma once
#include <optional>
#include <string>
#include <vector>

#include "tools/doctor/core/problem.hpp"

namespace ledgerline::doctor {

/// One line of the list.
struct Finding {
  std::string check;  ///< "identity"
  std::string what;   ///< of which file, place or drone, and what was found
  std::optional<Problem> problem{};
  std::string cure{};  ///< more exact than the problem's own; empty: that

  Verdict verdict() const { return problem ? words_of(*problem).verdict : Verdict::ok; }
};

inline Finding fine(std::string check, std::string what) { return {std::move(check), std::move(what)}; }
inline Finding found(Problem problem, std::string check, std::string what, std::string cure = {}) {
  return {std::move(check), std::move(what), problem, std::move(cure)};
}

using Findings = std::vector<Finding>;

/// Whether something is broken; warnings are not.
bool anything_broken(const Findings& findings);
/// A line each, a cure below what is not ok, and how many there were.
std::string words(const Findings& findings);
/// {"ok":true,"checks":[{"check":"identity","verdict":"broken","problem":"key_open"|null,"what":"...","cure":"..."|null}]}
std::string to_json(const Findings& findings);

/// What docs/troubleshooting.md has of these problems: a Markdown table.
std::string problems_table();

}  // namespace ledgerline::doctor
