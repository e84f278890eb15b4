#include "hil/fault/compare/comparison.hpp"

#include <algorithm>
#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/hypergeometric.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/special_functions/binomial.hpp>
#include <cmath>
#include <numeric>

namespace ledgerline::hil::comparing {
namespace {

/// Ranks from 1 on, ties have the middle one of theirs; doubled, so that each is a whole number.
struct Ranks {
  std::vector<std::size_t> doubled;  ///< in the order of the values
  double ties = 0;                   ///< sum of t^3 - t over groups of t equal values
};

Ranks ranks_of(const std::vector<double>& values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, {}, [&](std::size_t i) { return values[i]; });
  Ranks ranks{std::vector<std::size_t>(values.size()), 0};
  for (std::size_t begin = 0; begin < order.size();) {
    std::size_t end = begin;
    while (end < order.size() && values[order[end]] == values[order[begin]]) ++end;
    for (std::size_t i = begin; i < end; ++i) ranks.doubled[order[i]] = begin + 1 + end;
    const auto equal = static_cast<double>(end - begin);
    ranks.ties += equal * equal * equal - equal;
    begin = end;
  }
  return ranks;
}

int sign(double value) { return value > 0 ? 1 : value < 0 ? -1 : 0; }

/// Of a distribution over 0, 1, ..., how likely something at least as far from the middle of it as `seen` is.
double two_sided(const std::vector<double>& chances, double middle, std::size_t seen) {
  const double far = std::abs(static_cast<double>(seen) - middle);
  double p = 0;
  for (std::size_t sum = 0; sum < chances.size(); ++sum) {
    if (std::abs(static_cast<double>(sum) - middle) >= far - 1e-9) p += chances[sum];
  }
  return std::min(1.0, p);
}

// `step`: by how much the statistic changes at least, half of which is the correction for continuity.
double normal_two_sided(double far, double deviation, double step) {
  if (deviation <= 0) return 1;
  const double deviations = std::max(0.0, std::abs(far) - step / 2) / deviation;
  return 2 * cdf(complement(boost::math::normal(), deviations));
}

/// Chances of each sum of a subset of the ranks in which each rank is with chance 1/2.
std::vector<double> sums_of_any(const std::vector<std::size_t>& ranks) {
  std::vector<double> chances(std::accumulate(ranks.begin(), ranks.end(), std::size_t{0}) + 1, 0);
  chances[0] = 1;
  std::size_t top = 0;
  for (const std::size_t rank : ranks) {
    top += rank;
    for (std::size_t sum = top + 1; sum-- > 0;)
      chances[sum] = (chances[sum] + (sum >= rank ? chances[sum - rank] : 0)) / 2;
  }
  return chances;
}

/// The same of each subset of `count` ranks, all equally likely.
std::vector<double> sums_of(const std::vector<std::size_t>& ranks, std::size_t count) {
  const std::size_t most = std::accumulate(ranks.begin(), ranks.end(), std::size_t{0});
  std::vector<std::vector<double>> ways(count + 1, std::vector<double>(most + 1, 0));
  ways[0][0] = 1;
  for (const std::size_t rank : ranks) {
    for (std::size_t chosen = count; chosen-- > 0;) {
      for (std::size_t sum = most + 1; sum-- > rank;) ways[chosen + 1][sum] += ways[chosen][sum - rank];
    }
  }
  const double all = std::accumulate(ways[count].begin(), ways[count].end(), 0.0);
  for (double& chance : ways[count]) chance /= all;
  return ways[count];
}

/// In how many ways: infinitely many where a double cannot say.
double choose(std::size_t n, std::size_t k) {
  using boost::math::policies::ignore_error, boost::math::policies::overflow_error;
  return boost::math::binomial_coefficient<double>(static_cast<unsigned>(n), static_cast<unsigned>(k),
                                                   boost::math::policies::policy<overflow_error<ignore_error>>());
}

}  // namespace

TestResult signed_rank(std::span<const double> differences) {
  std::vector<double> sizes;
  std::vector<bool> greater;
  for (const double difference : differences) {
    if (difference == 0) continue;
    sizes.push_back(std::abs(difference));
    greater.push_back(difference > 0);
  }
  if (sizes.empty()) return {};
  const Ranks ranks = ranks_of(sizes);
  std::size_t sum = 0;
  for (std::size_t i = 0; i < sizes.size(); ++i) sum += greater[i] ? ranks.doubled[i] : 0;
  const auto n = static_cast<double>(sizes.size());
  const double middle = n * (n + 1) / 2;  // of doubled ranks
  TestResult result{.least_p = std::pow(2.0, 1 - n), .direction = sign(static_cast<double>(sum) - middle)};
  if (sizes.size() <= max_exact_pairs) {
    result.p = two_sided(sums_of_any(ranks.doubled), middle, sum);
  } else {
    const double variance = n * (n + 1) * (2 * n + 1) / 6 - ranks.ties / 12;  // four times that of single ranks
    result.p = normal_two_sided(static_cast<double>(sum) - middle, std::sqrt(variance), 2);
  }
  return result;
}

TestResult rank_sum(std::span<const double> first, std::span<const double> second) {
  if (first.empty() || second.empty()) return {};
  std::vector<double> values(first.begin(), first.end());
  values.insert(values.end(), second.begin(), second.end());
  const Ranks ranks = ranks_of(values);
  const std::size_t sum = std::accumulate(ranks.doubled.begin() + static_cast<std::ptrdiff_t>(first.size()),
                                          ranks.doubled.end(), std::size_t{0});
  const auto a = static_cast<double>(first.size()), b = static_cast<double>(second.size()), n = a + b;
  const double middle = b * (n + 1);  // of doubled ranks
  TestResult result{.least_p = std::min(1.0, 2 / choose(values.size(), first.size())),
                    .direction = sign(static_cast<double>(sum) - middle)};
  if (values.size() <= max_exact_sum) {
    result.p = two_sided(sums_of(ranks.doubled, second.size()), middle, sum);
  } else {
    const double variance = a * b / 3 * (n + 1 - ranks.ties / (n * (n - 1)));  // four times that of single ranks
    result.p = normal_two_sided(static_cast<double>(sum) - middle, std::sqrt(variance), 2);
  }
  return result;
}

TestResult mcnemar(std::size_t newly, std::size_t repaired) {
  const std::size_t changed = newly + repaired;
  if (changed == 0) return {};
  const boost::math::binomial coins(static_cast<double>(changed), 0.5);
  return {.p = std::min(1.0, 2 * cdf(coins, static_cast<double>(std::min(newly, repaired)))),
          .least_p = std::min(1.0, std::pow(2.0, 1 - static_cast<double>(changed))),
          .direction = sign(static_cast<double>(newly) - static_cast<double>(repaired))};
}

TestResult fisher(std::size_t first, std::size_t of_first, std::size_t second, std::size_t of_second) {
  if (of_first == 0 || of_second == 0) return {};
  const std::size_t both = first + second, all = of_first + of_second;
  const boost::math::hypergeometric drawn(static_cast<unsigned>(both), static_cast<unsigned>(of_second),
                                          static_cast<unsigned>(all));
  const auto chance = [&](std::size_t of_the_second) { return pdf(drawn, static_cast<unsigned>(of_the_second)); };
  TestResult result{.p = 0, .least_p = 1};
  const double seen = chance(second);
  for (std::size_t k = both > of_first ? both - of_first : 0; k <= std::min(both, of_second); ++k) {
    result.least_p = std::min(result.least_p, chance(k));
    if (chance(k) <= seen * (1 + 1e-9)) result.p += chance(k);
  }
  result.p = std::min(1.0, result.p);
  result.direction = sign(static_cast<double>(second) / static_cast<double>(of_second) -
                          static_cast<double>(first) / static_cast<double>(of_first));
  return result;
}

std::vector<double> holm(const std::vector<double>& p) {
  std::vector<std::size_t> order(p.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, {}, [&](std::size_t i) { return p[i]; });
  std::vector<double> corrected(p.size());
  double before = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    before = std::max(before, std::min(1.0, static_cast<double>(p.size() - i) * p[order[i]]));
    corrected[order[i]] = before;
  }
  return corrected;
}

std::size_t pairs_needed(std::size_t tests, double error_rate) {
  return 1 + static_cast<std::size_t>(
                 std::ceil(std::log2(static_cast<double>(std::max<std::size_t>(tests, 1)) / error_rate)));
}

}  // namespace ledgerline::hil::comparing
