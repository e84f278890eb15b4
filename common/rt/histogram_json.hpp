#pragma once
#include <cmath>
#include <nlohmann/json.hpp>

#include "common/rt/histogram.hpp"

namespace ledgerline {

/// For people's eyes: 1/1000 of the unit, or what `per_unit` says.
inline double rounded(double value, double per_unit = 1000) { return std::round(value * per_unit) / per_unit; }

/// For nlohmann::json, which finds it by name: `json{{"two_way_ms", quantiles}}`. Rounded to the histogram's 1 us.
inline void to_json(nlohmann::json& out, const Quantiles& q) {
  out = {{"p5", rounded(q.p5)},   {"q1", rounded(q.q1)},   {"median", rounded(q.median)}, {"q3", rounded(q.q3)},
         {"p95", rounded(q.p95)}, {"p99", rounded(q.p99)}, {"max", rounded(q.max)},       {"count", q.count}};
}

}  // namespace ledgerline
