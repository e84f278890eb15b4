#include "tools/timing/figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <sstream>

namespace ledgerline::timing {
namespace {

constexpr std::array<std::pair<std::string_view, double>, 4> quantiles{
    {{"p50", 0.5}, {"p95", 0.95}, {"p99", 0.99}, {"p99.9", 0.999}}};

/// The number, in the unit's own size; none when it is not a number of 0 or more with one of these units.
std::optional<double> amount(const std::string& text, const std::map<std::string, double>& units) {
  double number = 0;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  const auto unit = units.find(std::string(rest, text.data() + text.size()));
  if (error != std::errc() || unit == units.end() || !(number >= 0)) return std::nullopt;
  return number * unit->second;
}

bool is_quantile(const std::string& name) {
  return name == "max" ||
         std::any_of(quantiles.begin(), quantiles.end(), [&](const auto& q) { return q.first == name; });
}

std::vector<std::string> split(const std::string& text, char by) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, by);) parts.push_back(part);
  return parts;
}

}  // namespace

Result<Limit> parse_limit(const std::string& text) {
  const auto equals = text.find('=');
  if (equals == std::string::npos) return Error{fmt::format("\"{}\" is no limit: write p99.apply=1ms", text)};
  const std::string left = text.substr(0, equals), right = text.substr(equals + 1);
  Limit limit;
  limit.text = text;
  std::optional<double> bound;
  std::string unit;
  if (left == "overruns") {
    limit.quantity = left;
    bound = amount(right, {{"", 1}});
    unit = "a count, such as 0";
  } else if (left == "headroom" || left.starts_with("cpu.")) {
    limit.quantity = left.substr(0, left.find('.'));
    if (limit.quantity == "cpu") limit.programs = split(left.substr(4), '+');
    if (limit.quantity == "cpu" && limit.programs.empty()) return Error{fmt::format("\"{}\" names no program", text)};
    bound = amount(right, {{"%", 1}});
    unit = "percent of one core, such as 15%";
  } else {
    const auto dot = left.rfind('.');  // p99.9 has one of its own
    limit.quantity = left.substr(0, dot);
    limit.stage = dot == std::string::npos ? "" : left.substr(dot + 1);
    if (!is_quantile(limit.quantity)) {
      return Error{
          fmt::format("\"{}\": there is no quantity \"{}\"; there are p50, p95, p99, p99.9 and max of a stage, "
                      "cpu.PROGRAM, overruns "
                      "and headroom",
                      text, limit.quantity)};
    }
    const auto names = distribution_names();
    if (std::find(names.begin(), names.end(), limit.stage) == names.end())
      return Error{
          fmt::format("\"{}\": there is no stage \"{}\"; there are {}", text, limit.stage, fmt::join(names, ", "))};
    bound = amount(right, {{"us", 1e-3}, {"ms", 1}, {"s", 1e3}});
    unit = "a time, such as 200us, 1ms or 2s";
  }
  if (!bound) return Error{fmt::format("\"{}\": \"{}\" is not {}", text, right, unit)};
  limit.bound = *bound;
  return limit;
}

Verdict check(const Limit& limit, const Figures& figures) {
  Verdict verdict{limit.text, std::nullopt, false};
  if (limit.quantity == "overruns") {
    if (figures.loop.late.count() > 0) verdict.measured = static_cast<double>(figures.loop.overruns);
  } else if (limit.quantity == "headroom") {
    if (figures.load.seconds > 0) verdict.measured = figures.load.headroom_percent();
    verdict.kept = verdict.measured && *verdict.measured >= limit.bound;
    return verdict;
  } else if (limit.quantity == "cpu") {
    double sum = 0;
    for (const std::string& program : limit.programs) {
      const auto found = figures.load.programs.find(program);
      if (found == figures.load.programs.end()) return verdict;
      sum += found->second;
    }
    verdict.measured = sum;
  } else if (const Histogram* histogram = figures.find(limit.stage); histogram && histogram->count() > 0) {
    const auto q =
        std::find_if(quantiles.begin(), quantiles.end(), [&](const auto& one) { return one.first == limit.quantity; });
    verdict.measured = to_ms(q == quantiles.end() ? histogram->max() : histogram->quantile(q->second));
  }
  verdict.kept = verdict.measured && *verdict.measured <= limit.bound;
  return verdict;
}

}  // namespace ledgerline::timing
