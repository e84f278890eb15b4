#include "tools/bench/utm/workload.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

namespace ledgerline::utm {
namespace {

using nlohmann::json;

constexpr double warm_up_per_s = 35;  // at least: what compiles itself as it runs warms up by calls, not by seconds
constexpr int cells_wide = 40, layers = 4;
constexpr double cell_degrees = 0.01, layer_m = 30, slot_s = 600;

/// std's distributions differ between libraries; these do not.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : engine_(seed) {}
  double share() { return static_cast<double>(engine_() >> 11) * 0x1.0p-53; }  ///< [0, 1)
  double exponential(double mean) { return -mean * std::log1p(-share()); }
  std::uint64_t below(std::uint64_t n) { return engine_() % n; }

 private:
  std::mt19937_64 engine_;
};

Cell cell_of(int n) {
  const int layer = n / (cells_wide * cells_wide);
  return {n % cells_wide, n / cells_wide % cells_wide, layer % layers, layer / layers};
}

/// Circle or polygon, small enough to stay in its cell.
std::string volume(const Cell& cell, Dice& dice) {
  const double lat = 52.0 + (cell.y + 0.5) * cell_degrees, lon = 13.0 + (cell.x + 0.5) * cell_degrees;
  const double radius = cell_degrees * (0.1 + 0.3 * dice.share());
  std::string outline;
  if (dice.share() < 0.5) {
    outline = fmt::format("circle {:.5f} {:.5f} {:.5f}", lat, lon, radius);
  } else {
    outline = "polygon";
    const int corners = 4 + static_cast<int>(dice.below(3));
    constexpr double turn = 6.283185307179586;
    for (int k = 0; k < corners; ++k) {
      const double angle = turn * k / corners;
      outline += fmt::format(" {:.5f} {:.5f}", lat + radius * std::sin(angle), lon + radius * std::cos(angle));
    }
  }
  const double begin = cell.slot * slot_s, low = 30 + cell.layer * layer_m;
  return fmt::format("{};{:.0f}-{:.0f}m;{:.0f}-{:.0f}s", outline, low + 2, low + layer_m - 2, begin + 5,
                     begin + slot_s - 5);
}

bool is_number(const json& object, const char* key) { return object.contains(key) && object[key].is_number(); }
bool is_text(const json& object, const char* key) { return object.contains(key) && object[key].is_string(); }

}  // namespace

std::vector<Intent> make_workload(const WorkloadOptions& o) {
  Dice dice(o.seed);
  std::vector<Intent> intents;
  int cells = 0;
  double at_s = 0;
  while (true) {
    const double rate_per_s = at_s < o.warm_up_s ? std::max(o.rate_per_s, warm_up_per_s) : o.rate_per_s;
    at_s += o.poisson ? dice.exponential(1 / rate_per_s) : 1 / rate_per_s;
    if (at_s >= o.warm_up_s + o.seconds) return intents;
    Intent intent;
    intent.at_ns = from_seconds(at_s);
    if (!intents.empty() && dice.share() < o.overlapping) {
      const bool races = dice.share() < o.racing;
      const Intent& rival = races ? intents.back() : intents[dice.below(intents.size())];
      intent.overlaps = true;
      intent.cell = rival.cell;
      if (races) intent.at_ns = rival.at_ns;
    } else {
      intent.cell = cell_of(cells++);
    }
    intent.measured = intent.at_ns >= from_seconds(o.warm_up_s);
    const Cell& c = intent.cell;
    intent.airspace = fmt::format("{}/{}/{}/{}/{}", o.airspace, c.x, c.y, c.layer, c.slot);
    const auto supplier = dice.below(static_cast<std::uint64_t>(o.suppliers));
    intent.what = fmt::format("oi {:08x};uss{}.Org{}MSP;Accepted;0;{}", intents.size() + 1, supplier + 1,
                              supplier % 3 + 1, volume(c, dice));
    intents.push_back(std::move(intent));
  }
}

double RetryPolicy::pause_ms(int attempt, double jitter) const {
  const double whole = std::min(max_ms, first_ms * std::exp2(std::clamp(attempt, 1, 30) - 1));
  return whole * (0.5 + 0.5 * jitter);
}

json to_json(const Job& job) {
  json intents = json::array();
  for (const Intent& i : job.intents) {
    intents.push_back({{"at_ns", i.at_ns}, {"measured", i.measured}, {"airspace", i.airspace}, {"what", i.what}});
  }
  return {{"intents", intents},         {"attempts", job.retry.attempts}, {"first_ms", job.retry.first_ms},
          {"max_ms", job.retry.max_ms}, {"drain_s", job.drain_s},         {"seed", job.seed}};
}

Result<Job> read_job(const std::string& text) {
  const json j = json::parse(text, nullptr, false);
  if (!j.is_object() || !j.contains("intents") || !j["intents"].is_array()) return Error{"the job has no intents"};
  for (const char* key : {"attempts", "first_ms", "max_ms", "drain_s", "seed"}) {
    if (!is_number(j, key)) return Error{fmt::format("the job has no {}", key)};
  }
  Job job;
  job.retry = {j["attempts"], j["first_ms"], j["max_ms"]};
  job.drain_s = j["drain_s"];
  job.seed = j["seed"];
  for (const json& one : j["intents"]) {
    if (!one.is_object() || !is_number(one, "at_ns") || !is_text(one, "airspace") || !is_text(one, "what") ||
        !one.contains("measured") || !one["measured"].is_boolean()) {
      return Error{"an intent of the job is damaged"};
    }
    Intent intent;
    intent.at_ns = one["at_ns"];
    intent.measured = one["measured"];
    intent.airspace = one["airspace"];
    intent.what = one["what"];
    job.intents.push_back(std::move(intent));
  }
  return job;
}

}  // namespace ledgerline::utm
