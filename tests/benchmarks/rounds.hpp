#pragma once
#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <vector>

#include "common/rt/histogram.hpp"

/// What benchmarks say of the figures of their rounds, and of the machine.
namespace ledgerline {

struct Quartiles {
  double q1, median, q3;
};
inline Quartiles quartiles(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double q) {
    return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
  };
  return {at(0.25), at(0.5), at(0.75)};
}
inline void to_json(nlohmann::json& json, const Quartiles& q) {
  json = {{"q1", rounded(q.q1)}, {"median", rounded(q.median)}, {"q3", rounded(q.q3)}};
}

inline double load_average() {
  double load = 0;
  std::ifstream("/proc/loadavg") >> load;
  return load;
}

}  // namespace ledgerline
