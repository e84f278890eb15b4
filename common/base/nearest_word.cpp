#include "common/base/nearest_word.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

namespace ledgerline {
namespace {

std::size_t edits_between(const std::string& from, const std::string& to) {  // Levenshtein's
  std::vector<std::size_t> row(to.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < from.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < to.size(); ++j) {
      const std::size_t replaced = diagonal + (from[i] == to[j] ? 0 : 1);
      diagonal = std::exchange(row[j + 1], std::min({replaced, row[j] + 1, row[j + 1] + 1}));
    }
  }
  return row.back();
}

}  // namespace

std::string nearest_word(const std::string& typed, const std::vector<std::string>& known) {
  constexpr std::size_t max_edits = 2, max_length = 64;  // of what is typed: the work is bounded
  if (typed.size() > max_length || known.empty()) return "";
  const auto edits = [&](const std::string& word) { return edits_between(typed, word); };
  const std::string& near = *std::ranges::min_element(known, {}, edits);
  return edits(near) <= std::min(max_edits, typed.size() / 2) ? near : "";
}

std::string did_you_mean(const std::string& lead, const std::string& typed, const std::vector<std::string>& known) {
  const std::string near = nearest_word(typed, known);
  return near.empty() ? "" : lead + "did you mean " + near + "?";
}

}  // namespace ledgerline
