#pragma once
#include <cstddef>
#include <span>
#include <vector>

// Tests that distinguish a change from noise. They look at ranks alone: a flight's figures follow no known
// distribution, and one flight that went astray must not decide. Pure functions; all are two-sided.
namespace ledgerline::hil::comparing {

struct TestResult {
  double p = 1;        ///< chance that equal builds differ so much, or more
  double least_p = 1;  ///< that with so many runs p can be at best
  int direction = 0;   ///< 1: the second sample is greater, -1: it is less, by the ranks; 0: neither
};

/// Wilcoxon's signed-rank test of paired differences (second minus first); those of 0 are left out. The distribution is
/// exact, with ties, up to max_exact_pairs; beyond that the normal one, which in the tails says a larger p than the
/// exact.
TestResult signed_rank(std::span<const double> differences);
inline constexpr std::size_t max_exact_pairs = 60;

/// The Wilcoxon-Mann-Whitney rank-sum test of two samples that nothing pairs; exact, with ties, for up to
/// max_exact_sum values together.
TestResult rank_sum(std::span<const double> first, std::span<const double> second);
inline constexpr std::size_t max_exact_sum = 30;

/// McNemar's exact test of pairs that changed: so many broke newly, and so many were repaired.
TestResult mcnemar(std::size_t newly, std::size_t repaired);

/// Fisher's exact test: so many of so many in each of two samples.
TestResult fisher(std::size_t first, std::size_t of_first, std::size_t second, std::size_t of_second);

/// Holm's correction: with these in place of the p values, the chance that any of the tests of equal builds is below
/// `error_rate` is at most `error_rate`. In the order given.
std::vector<double> holm(const std::vector<double>& p);

/// So many pairs, at least, a signed-rank test among `tests` needs to get below `error_rate` behind Holm's correction.
std::size_t pairs_needed(std::size_t tests, double error_rate);

}  // namespace ledgerline::hil::comparing
