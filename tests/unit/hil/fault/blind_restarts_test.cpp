#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "common/base/random.hpp"
#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"
#include "tests/unit/campaign.hpp"

/// Link dies in flight, and its successor does not see the drone: each of the four Tellos that nobody knows apart, with
/// whatever is deaf. Landed within 25 s of the death, and inside the fence plus half a metre.
namespace ledgerline::hil {
namespace {

constexpr int slice = slow ? 1 : 8;

enum class Deaf : std::uint8_t { states, both_ways, answers };
constexpr std::array<const char*, 3> deaf_lines{"states", "both", "answers"};

struct BlindRestart {
  Script script;
  Deaf deaf{};
  bool keeps_rc = false, command_counts = false;
  /// A Tello that keeps its last rc and hears nothing flies on with it until its own rule lands it: no link has a say
  /// in where it goes, only physics has.
  bool flies_on() const { return deaf == Deaf::both_ways && keeps_rc; }
};

BlindRestart blind_restart(std::uint64_t seed, int kind) {
  Random random(seed * 6'364'136'223'846'793'005U + 99);
  const auto between = [&](double least, double most) { return least + (most - least) * random.uniform(); };
  BlindRestart made;
  made.deaf = static_cast<Deaf>(random.next() % 3);
  made.keeps_rc = (kind & 1) != 0;
  made.command_counts = (kind & 2) != 0;
  constexpr std::array<const char*, 4> shapes{"square", "triangle", "x", "eight"};
  constexpr std::array<const char*, 6> moments{"takeoff", "flying", "path", "path", "path", "landing"};
  const char* shape = shapes[random.next() % shapes.size()];
  const char* moment = moments[random.next() % moments.size()];
  const double speed = between(0.3, 1.0);
  const double lap_s = 3 * 1.5 / speed;  // of the shortest, the triangle
  const std::string_view begin = moment;
  const double after_ms = begin == "path" ? between(1, 900 * lap_s) : between(1, begin == "landing" ? 1'500 : 2'500);
  const double gap_ms = between(20, 2'500);
  std::string text = fmt::format(
      "title = \"Link dies, and its successor is deaf\"\nmust = [\"lands within 25 s\"{}]\n[flight]\nshape = \"{}\"\n"
      "speed_mps = {:.3f}\nkeeps_rc = {}\ncommand_counts = {}\n",
      made.flies_on() ? "" : ", \"fence kept within 0.5 m\"", shape, speed, made.keeps_rc, made.command_counts);
  text += fmt::format("[[fault]]\nwhat = \"link kill\"\nat = \"{} + {:.0f}ms\"\nfor = \"{:.0f}ms\"\n", moment, after_ms,
                      gap_ms);
  text += fmt::format("[[fault]]\nwhat = \"drone tello1 {} partition\"\nat = \"{} + {:.0f}ms\"\n",
                      deaf_lines[static_cast<std::size_t>(made.deaf)], moment, after_ms);
  auto script = parse_script(text, fmt::format("blind-{}-{}.toml", seed, kind));
  EXPECT_TRUE(script.ok()) << script.error().message;
  if (script) made.script = std::move(*script);
  return made;
}

/// When link died; 0: never.
TimeNs death_of(const RunResult& result) {
  for (const WorldEvent& event : result.events) {
    if (event.kind == WorldEvent::Kind::fault) return event.t_ns;
  }
  return 0;
}

struct Flown {
  double down_s = 0;    ///< from the death until it is down for good
  double moved_m = 0;   ///< from the place of the death
  double sent_mps = 0;  ///< at the death
};

Flown flown(const RunResult& result) {
  const TimeNs death = death_of(result);
  Flown flown;
  const TimelinePoint* at_death = nullptr;
  for (const TimelinePoint& point : result.timeline[0]) {
    if (point.t_ns < death) {
      flown.sent_mps = static_cast<double>(point.sent_mps);  // its successor may be there by the next point
      continue;
    }
    if (!at_death) at_death = &point;
    if (point.at_m[2] > on_ground_m) flown.down_s = to_seconds(point.t_ns - death);
    flown.moved_m = std::max<double>(flown.moved_m,
                                     std::hypot(point.at_m[0] - at_death->at_m[0], point.at_m[1] - at_death->at_m[1]));
  }
  return flown;
}

TEST(BlindRestartCampaign, EveryDroneIsLandedWithin25SecondsInsideTheFencePlusHalfAMetre) {
  const int all = seeds(slice, 1'000);
  std::vector<BlindRestart> made;
  for (int kind = 0; kind < 4; ++kind) {
    for (int seed = 1; seed <= all; ++seed) made.push_back(blind_restart(static_cast<std::uint64_t>(seed), kind));
  }
  struct Sum {
    int flights = 0, held = 0;
    double down_s = 0, moved_m = 0;  ///< the worst
  };
  std::array<std::array<Sum, 3>, 4> sums{};
  const TimeNs begin = monotonic_ns();
  fly_all(
      made.size(), 2,
      [&](std::size_t i) {
        return Flight{made[i].script, i % static_cast<std::size_t>(all) + 1};
      },
      [&](std::size_t i, const Flight& flight, Result<RunResult> result) {
        EXPECT_TRUE(result.ok()) << flight.script.name;
        if (!result) return true;
        const BlindRestart& one = made[i];
        EXPECT_TRUE(result->all_held()) << flight.script.name << " seed " << flight.seed << "\n"
                                        << text_of(flight.script) << broken_text(*result);
        const Flown how = flown(*result);
        // On its last rc for 15 s; and what it needs to stop, and gusts.
        const double max_m = one.flies_on() ? 15 * how.sent_mps + 1.5 : 100;
        EXPECT_LE(how.moved_m, max_m) << text_of(flight.script);
        Sum& sum = sums[i / static_cast<std::size_t>(all)][static_cast<std::size_t>(one.deaf)];
        ++sum.flights;
        sum.held += result->all_held();
        sum.down_s = std::max(sum.down_s, how.down_s);
        sum.moved_m = std::max(sum.moved_m, how.moved_m);
        return true;
      });
  std::printf("keeps rc  command counts  deaf       flights  held  down after, s  moved, m\n");
  for (std::size_t kind = 0; kind < sums.size(); ++kind) {
    for (std::size_t deaf = 0; deaf < deaf_lines.size(); ++deaf) {
      const Sum& sum = sums[kind][deaf];
      std::printf("%-8s  %-14s  %-9s  %7d  %4d  %13.1f  %8.2f\n", kind & 1 ? "yes" : "no", kind & 2 ? "yes" : "no",
                  deaf_lines[deaf], sum.flights, sum.held, sum.down_s, sum.moved_m);
    }
  }
  std::printf("%zu blind restarts in %.0f s\n", made.size(), to_seconds(monotonic_ns() - begin));
}

}  // namespace
}  // namespace ledgerline::hil
