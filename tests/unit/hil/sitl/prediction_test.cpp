// How well prediction flies, as docs/control.md has it, checked against the simulator's truth. Two seeds in every
// run, ten with LEDGERLINE_LONG=1. All flights in gusts of 0.1 m/s; drones that can be commanded up to 2 m/s, so that
// no limit of theirs stands in for good control.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "hil/sitl/simulated_flight.hpp"
#include "tests/unit/campaign.hpp"
#include "tools/report/results.hpp"

namespace ledgerline::hil {
namespace {

/// Top speed of a ramp: the largest speed of a lap that was flown with an error below this, all slower ones too.
constexpr double top_speed_error_m = 0.4;
/// A lap fails when its error is above this.
constexpr double failing_error_m = 1.0;

using Drone = SimulatedFlightResult::Drone;

// Of local's rms, with the published delay, its tail and all. The bar is 1.3, which experiment 8 checks:
// docs/control.md says how it stands.
constexpr double beside_local = 1.5;

enum class Way { local, embedded, published, published_plain, two_seconds };

SimulatedFlightConfig config_for(Way way) {
  SimulatedFlightConfig config;
  config.speed_mps = 1.0;
  config.full_scale_mps = 2.0;
  if (way == Way::local) config.mode = SimulatedFlightConfig::Mode::local;
  if (way == Way::published || way == Way::published_plain) config.delays.added.published = &published_delays[0];
  if (way == Way::published_plain) config.predict = false;
  if (way == Way::two_seconds) config.delays.added.own = Distribution::constant(2 * ns_per_s);
  return config;
}

/// One flight for each seed from 1 on.
std::vector<SimulatedFlightResult> fly(SimulatedFlightConfig config, int count) {
  std::vector<SimulatedFlightResult> flights;
  for (int seed = 1; seed <= count; ++seed) {
    config.seed = static_cast<std::uint64_t>(seed);
    auto flight = fly_simulated(config);
    EXPECT_TRUE(flight.ok()) << flight.error().message;
    if (flight.ok()) flights.push_back(*flight);
  }
  return flights;
}

struct Metrics {
  double rms_m = 0, max_m = 0, laps_s = 0;
};

/// Over all flights, from this lap (0: the first) on.
Metrics over(const std::vector<SimulatedFlightResult>& flights, std::size_t from_lap = 0) {
  Metrics all;
  double squares = 0, seconds = 0;
  for (const auto& flight : flights) {
    const auto& laps = flight.drones[0].laps;
    for (std::size_t i = from_lap; i < laps.size(); ++i) {
      squares += laps[i].rms_m * laps[i].rms_m * laps[i].seconds;
      seconds += laps[i].seconds;
      all.max_m = std::max(all.max_m, laps[i].max_m);
    }
  }
  all.laps_s = seconds / static_cast<double>(flights.size());
  all.rms_m = std::sqrt(squares / seconds);
  return all;
}

void print(const char* what, const std::vector<SimulatedFlightResult>& flights, const Metrics& f,
           const Metrics& local) {
  const Quantiles& q = flights[0].drones[0].two_way_ms;
  fmt::print(
      "  {:<34} rms {:.4f} m ({:.2f} x local)  max {:.3f} m  laps {:.2f} s  two-way median {:.0f} p99 {:.0f} ms\n",
      what, f.rms_m, f.rms_m / local.rms_m, f.max_m, f.laps_s, q.median, q.p99);
}

void expect_flown(const std::vector<SimulatedFlightResult>& flights) {
  for (std::size_t i = 0; i < flights.size(); ++i) EXPECT_TRUE(flights[i].ok) << "seed " << i + 1 << flights[i].why;
}

// The simulator's drone is of another order than the model: its velocity loop drives an attitude loop and motors. What
// can be compared: the gain, and the whole lag, which is where the slow part of both is.
void expect_learned(const SimulatedFlightResult& flight, double error) {
  constexpr double velocity_lag_s = 0.3;  // the simulator's
  const ground::motion::Response& r = flight.drones[0].response;
  fmt::print("  truth: gain {:.2f}, lag {:.3f} s; learned: gain {:.3f}, lag {:.3f} + {:.3f} s\n", 1 + error,
             velocity_lag_s * (1 + error), r.gain, r.lag_s, r.dead_s);
  EXPECT_NEAR(r.gain, 1 + error, 0.06);
  EXPECT_NEAR(r.lag_s + r.dead_s, velocity_lag_s * (1 + error), 0.05);
}

TEST(Prediction, WithThePublishedDelayItFliesAsIfOnBoardAndThePlainControllerFails) {
  const int count = seeds(2, 10);
  const auto local = fly(config_for(Way::local), count);
  const auto embedded = fly(config_for(Way::embedded), count);
  const auto published = fly(config_for(Way::published), count);
  const auto plain = fly(config_for(Way::published_plain), count);
  expect_flown(local);
  expect_flown(embedded);
  expect_flown(published);
  const Metrics beside = over(local), near = over(embedded), far = over(published), without = over(plain);
  fmt::print("square of 1.5 m, 1 m/s, {} seeds\n", count);
  print("local", local, beside, beside);
  print("embedded ledger", embedded, near, beside);
  print("published delay", published, far, beside);
  print("published delay, no prediction", plain, without, beside);
  EXPECT_LE(far.rms_m, beside_local * beside.rms_m);
  EXPECT_LE(near.rms_m, 1.3 * beside.rms_m);
  EXPECT_NEAR(far.laps_s, beside.laps_s, 0.05 * beside.laps_s);
  for (const auto& flight : plain) EXPECT_GE(flight.drones[0].cross_track_max_m, failing_error_m);
  for (const auto& flight : published) {
    EXPECT_NEAR(flight.drones[0].two_way_ms.median, 460, 30);
    // Of those that overtook each other the newest is flown: no more of them than one of ten.
    EXPECT_LT(flight.drones[0].commands_applied, flight.drones[0].commands_sent);
    EXPECT_GE(flight.drones[0].commands_applied, 0.9 * static_cast<double>(flight.drones[0].commands_sent));
  }
}

// Between agent and ledger alone, where ground's own commands do not show it, or between ground and ledger alone.
TEST(Prediction, OnWhicheverSideTheDelayLiesItFliesAsWellAsWithHalfOnEach) {
  const int count = seeds(3, 10);
  for (const double delay_s : {0.25, 0.5}) {
    SimulatedFlightConfig config = config_for(Way::embedded);
    config.delays.added.own = Distribution::constant(from_seconds(delay_s));
    const auto both = fly(config, count);
    expect_flown(both);
    const Metrics even = over(both);
    fmt::print("{} s of delay, {} seeds (local: here half on each side)\n", delay_s, count);
    print("half on each side", both, even, even);
    for (const auto& [side, share] : {std::pair{"agent's side alone", 1.0}, std::pair{"ground's side alone", 0.0}}) {
      config.delays.added.agent_share = share;
      const auto flights = fly(config, count);
      expect_flown(flights);
      const Metrics one = over(flights);
      print(side, flights, one, even);
      EXPECT_LE(one.rms_m, 1.35 * even.rms_m) << side << ", " << delay_s << " s";
      EXPECT_NEAR(one.laps_s, even.laps_s, 0.05 * even.laps_s);
    }
  }
}

TEST(Prediction, AModelThatIsThirtyPercentOffIsLearnedWithinTwoLaps) {
  const int count = seeds(2, 10);
  for (const double error : {0.3, -0.3}) {
    SimulatedFlightConfig config = config_for(Way::local);
    config.laps = 5;
    config.model_error = error;
    const auto local = fly(config, count);
    config = config_for(Way::published);
    config.laps = 5;
    config.model_error = error;
    const auto published = fly(config, count);
    expect_flown(local);
    expect_flown(published);
    const Metrics beside = over(local, 2), far = over(published, 2);
    fmt::print("mass, gain and lag {:+.0f} %, third lap on, {} seeds\n", 100 * error, count);
    print("local", local, beside, beside);
    print("published delay", published, far, beside);
    EXPECT_LE(far.rms_m, beside_local * beside.rms_m);
    EXPECT_NEAR(far.laps_s, beside.laps_s, 0.05 * beside.laps_s);
    for (const auto& flight : published) expect_learned(flight, error);
  }
}

TEST(Prediction, WhatItLearnsIsTheSimulatorsTruth) {
  for (const Way way : {Way::local, Way::embedded, Way::published}) {
    for (const auto& flight : fly(config_for(way), seeds(1, 5))) expect_learned(flight, 0);
  }
}

TEST(Prediction, AtTwoSecondsOfDelayItChoosesASpeedOfItsOwnAndStaysOnThePath) {
  const auto flights = fly(config_for(Way::two_seconds), seeds(2, 10));
  expect_flown(flights);
  for (const auto& flight : flights) {
    const Drone& drone = flight.drones[0];
    fmt::print("  2 s: slowed to {:.2f} m/s at least, then {:.2f}; rms {:.3f} m, max {:.3f} m; laps {:.1f} s\n",
               drone.slowed_to_mps.value_or(0), drone.limit_mps, drone.cross_track_rms_m, drone.cross_track_max_m,
               over({flight}).laps_s);
    ASSERT_TRUE(drone.slowed_to_mps);
    EXPECT_LT(*drone.slowed_to_mps, 0.5);
    // As it was really flown: slower at first than it may once it knows how well it predicts, and never at a crawl.
    ASSERT_EQ(drone.laps.size(), 3U);
    EXPECT_GT(drone.laps.front().flown_mps, 0.3);
    EXPECT_LT(drone.laps.front().flown_mps, 0.9 * drone.laps.back().flown_mps);
    EXPECT_LT(drone.cross_track_max_m, failing_error_m);
  }
}

/// As asked for, and as it was flown: of the last lap of a ramp before one with an error of top_speed_error_m.
struct TopSpeed {
  double asked_mps = 0, flown_mps = 0;
};
TopSpeed top_speed(const SimulatedFlightResult& flight) {
  TopSpeed top;
  for (const auto& lap : flight.drones[0].laps) {
    if (lap.max_m >= top_speed_error_m) break;
    top = {lap.asked_mps, std::max(top.flown_mps, lap.flown_mps)};
  }
  return top;
}

TEST(Prediction, TheTopSpeedOfARampIsNearlyThatOfALocalController) {
  const auto ramp = [](Way way) {
    SimulatedFlightConfig config = config_for(way);
    config.full_scale_mps = 4;
    config.side_m = 6;
    config.laps = seeds(6, 12);
    config.ramp = {0.5, seeds(1, 10) == 1 ? 0.5 : 0.25};
    return config;
  };
  const int count = seeds(1, 10);
  const auto local = fly(ramp(Way::local), count), embedded = fly(ramp(Way::embedded), count),
             published = fly(ramp(Way::published), count), plain = fly(ramp(Way::published_plain), count);
  for (int i = 0; i < count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const TopSpeed beside = top_speed(local[k]), near = top_speed(embedded[k]), far = top_speed(published[k]),
                   without = top_speed(plain[k]);
    fmt::print(
        "  seed {}: top speed asked (flown) m/s: local {:.2f} ({:.2f}), embedded {:.2f} ({:.2f}), published delay "
        "{:.2f} "
        "({:.2f}), without prediction {:.2f} ({:.2f})\n",
        i + 1, beside.asked_mps, beside.flown_mps, near.asked_mps, near.flown_mps, far.asked_mps, far.flown_mps,
        without.asked_mps, without.flown_mps);
    EXPECT_GE(far.asked_mps, 0.8 * beside.asked_mps);
    EXPECT_GE(far.flown_mps, 0.8 * beside.flown_mps);
    EXPECT_GE(near.asked_mps, 0.95 * beside.asked_mps);
    EXPECT_GE(near.flown_mps, 0.95 * beside.flown_mps);
    EXPECT_LT(without.asked_mps, far.asked_mps);
  }
}

TEST(Prediction, TheSameSeedWithTheSameDelayGivesTheSameBytes) {
  SimulatedFlightConfig config = config_for(Way::published);
  config.laps = 1;
  const auto one = fly(config, 1), two = fly(config, 1);
  EXPECT_EQ(one[0].digest, two[0].digest);
}

TEST(AddedDelay, WhatIsMeasuredHasThePublishedBoxAndATailBeyondItsWhisker) {
  for (const PublishedDelay& published : published_delays) {
    SimulatedFlightConfig config = config_for(Way::published);
    config.delays.added.published = &published;
    config.laps = seeds(8, 60);
    const Quantiles q = fly(config, 1)[0].drones[0].two_way_ms;
    const auto& box = report::published_boxes[static_cast<std::size_t>(&published - published_delays.data())];
    fmt::print("  {:<18} p5 {:.0f} q1 {:.0f} median {:.0f} q3 {:.0f} p95 {:.0f} p99 {:.0f} max {:.0f} ms\n",
               published.name, q.p5, q.q1, q.median, q.q3, q.p95, q.p99, q.max);
    EXPECT_NEAR(q.q1, 1e3 * box.q1_s, 0.05 * 1e3 * box.q1_s) << published.name;
    EXPECT_NEAR(q.median, 1e3 * box.median_s, 0.05 * 1e3 * box.median_s) << published.name;
    EXPECT_NEAR(q.q3, 1e3 * box.q3_s, 0.05 * 1e3 * box.q3_s) << published.name;
    EXPECT_GT(q.p5, 1e3 * box.low_s) << published.name;
    EXPECT_LT(q.p95, 1e3 * box.high_s * 1.15) << published.name;
    EXPECT_GT(q.p99, 1e3 * box.high_s + 89) << published.name << ": the square's is beyond 0.8 s";
    EXPECT_LT(q.max, 1e3 * (box.high_s + 1)) << published.name;
  }
}

// None overtakes the one before: that is for the newest to answer.
TEST(AddedDelay, BothWaysTogetherAreOneDrawAndARecordingKeepsItsOrder) {
  const ReadRecording file = [](const std::string& path) { return parse_recording(path, "0.2\n0.3\n0.38\n0.25\n"); };
  const auto added = added_delay_from("a file.txt", file);
  ASSERT_TRUE(added.ok()) << added.error().message;
  OneWayDelay there(*added, OneWayDelay::Direction::there, 0.5, 7), back(*added, OneWayDelay::Direction::back, 0.5, 7);
  std::vector<TimeNs> halves;
  for (TimeNs sent = 0; sent < 20 * 100 * ns_per_ms; sent += 100 * ns_per_ms) {
    halves.push_back(there.at(sent));
    EXPECT_EQ(back.at(sent + halves.back()), halves.back()) << "sent at " << to_ms(sent);
  }
  for (std::size_t i = 4; i < halves.size(); ++i) EXPECT_EQ(halves[i], halves[i - 4]);
  std::sort(halves.begin(), halves.end());
  EXPECT_EQ(halves.front(), 100 * ns_per_ms);
  EXPECT_EQ(halves.back(), 190 * ns_per_ms);
}

TEST(AddedDelay, IsReadOrRefusedByName) {
  EXPECT_TRUE(added_delay_from("none")->none());
  EXPECT_EQ(added_delay_from("published")->published->name, "published");
  EXPECT_EQ(added_delay_from("published-three")->published->name, "published-three");
  EXPECT_EQ(added_delay_from("0.25")->own->a, 250 * ns_per_ms);
  EXPECT_FALSE(added_delay_from("0")->none()) << "asked for, if of no length";
  for (const char* wrong : {"", "soon", "-1", "3.5", "nan", "1s"}) EXPECT_FALSE(added_delay_from(wrong).ok()) << wrong;
  const auto recorded = [](const char* text) {
    return added_delay_from("delays.txt", [=](const std::string& path) { return parse_recording(path, text); });
  };
  EXPECT_EQ(recorded("# two-way\n0.5\n3\n")->own->values->size(), 2U);
  EXPECT_EQ(recorded("0.5\n3.1\n").error().message, "delays.txt: 3.1 s is longer than the 3 s that can be added");
  EXPECT_EQ(recorded("0.5\nsoon\n").error().message, "delays.txt:2: \"soon\" is no number of seconds from 0 to 60");
}

}  // namespace
}  // namespace ledgerline::hil
