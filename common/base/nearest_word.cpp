#include "common/base/nearest_word.hpp"

#include <algorithm>

namespace ledgerline {
namespace {

/// Of optimal string alignment: a character left out, put in, replaced, or two neighbours exchanged.
std::size_t edits_between(const std::string& from, const std::string& to) {
  std::vector<std::vector<std::size_t>> edits(from.size() + 1, std::vector<std::size_t>(to.size() + 1));
  for (std::size_t i = 0; i <= from.size(); ++i) {
    for (std::size_t j = 0; j <= to.size(); ++j) {
      if (i == 0 || j == 0) {
        edits[i][j] = i + j;
        continue;
      }
      const bool same = from[i - 1] == to[j - 1];
      edits[i][j] = std::min({edits[i - 1][j - 1] + (same ? 0 : 1), edits[i - 1][j] + 1, edits[i][j - 1] + 1});
      if (i > 1 && j > 1 && from[i - 1] == to[j - 2] && from[i - 2] == to[j - 1])
        edits[i][j] = std::min(edits[i][j], edits[i - 2][j - 2] + 1);
    }
  }
  return edits.back().back();
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
