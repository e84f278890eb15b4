#include "hil/fault/run/metrics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>
#include <string>

namespace ledgerline::hil {
namespace {

/// Two drones that fly, a millisecond each.
struct Flown {
  Flown() {
    drones.resize(2);
    for (std::size_t i = 0; i < 2; ++i) {
      drones[i].phase = LinkPhase::flying;
      drones[i].truth.in_flight = true;
      drones[i].truth.position_m = {static_cast<double>(2 * i), 0, 1};
    }
  }
  void pass(TimeNs for_ns) {
    for (const TimeNs end = now + for_ns; now < end;) {
      now += ns_per_ms;
      Moment moment;
      moment.now = now;
      moment.drones = drones;
      moment.events = events;
      maker.observe(moment);
      events.clear();
    }
  }
  std::map<std::string, double> metrics() const {
    std::map<std::string, double> values;
    for (const MetricValue& metric : maker.finish(now)) values[std::string(metric.name)] = metric.value;
    return values;
  }

  MetricRecorder maker{Limits{}};
  std::vector<DroneObservation> drones;
  std::vector<WorldEvent> events;
  TimeNs now = 0;
};

TEST(Metrics, EachHasARowOfTheTableAndNoTwoHaveOneName) {
  std::set<std::string_view> names;
  for (const MetricKind& kind : metric_kinds()) {
    EXPECT_TRUE(names.insert(kind.name).second) << kind.name;
    EXPECT_GT(kind.least, 0) << kind.name;
    EXPECT_EQ(metric_kind(kind.name), &kind);
  }
  EXPECT_EQ(metric_kind("wings"), nullptr);
  Flown flown;
  flown.drones[0].off_path_m = 0.1;
  flown.events = {{0, WorldEvent::Kind::applied, 0, 0.08, {}, 1}};
  flown.pass(ns_per_s);
  for (const auto& [name, value] : flown.metrics()) EXPECT_NE(metric_kind(name), nullptr) << name;
}

TEST(Metrics, OfErrorsAreTheRootMeanSquareAndTheMost) {
  Flown flown;
  flown.drones[0].off_path_m = 0.3;
  flown.drones[1].off_path_m = 0.4;
  flown.drones[0].pose = Pose{};
  flown.drones[0].pose->position_m = {0, 0.06, 1};
  flown.drones[1].truth.velocity_mps = {0.3, 0, 0.4};
  flown.pass(ns_per_s);
  const auto metrics = flown.metrics();
  EXPECT_NEAR(metrics.at("path_rms_m"), std::sqrt((0.09 + 0.16) / 2), 1e-12);
  EXPECT_EQ(metrics.at("path_max_m"), 0.4);
  EXPECT_NEAR(metrics.at("pose_rms_m"), 0.06, 1e-12);
  EXPECT_NEAR(metrics.at("pose_max_m"), 0.06, 1e-12);
  EXPECT_NEAR(metrics.at("speed_max_mps"), 0.5, 1e-12);
  EXPECT_EQ(metrics.at("nearest_m"), 2);
  EXPECT_NEAR(metrics.at("flown_s"), 1, 1e-9);
}

TEST(Metrics, OfTheFenceTellTheTruthBesideTheEstimate) {
  Flown flown;
  flown.drones[0].truth.position_m = {Limits{}.fence_max_m[0] + 3, 0, 1};
  flown.drones[0].pose = Pose{};
  flown.drones[0].pose->position_m = {0, Limits{}.fence_min_m[1] - 0.5, 1};
  flown.pass(ns_per_s);
  EXPECT_NEAR(flown.metrics().at("beyond_fence_m"), 3, 1e-9);
  EXPECT_NEAR(flown.metrics().at("pose_beyond_fence_m"), 0.5, 1e-9);
}

TEST(Metrics, CountHoldsInFlightAndHowLongTheyLast) {
  Flown flown;
  const auto mode = [&](FailsafeMode mode, TimeNs lasts) {
    flown.drones[0].mode = mode;
    flown.pass(lasts);
  };
  mode(FailsafeMode::hold, 200 * ns_per_ms);
  mode(FailsafeMode::none, 100 * ns_per_ms);
  mode(FailsafeMode::hold, 300 * ns_per_ms);
  mode(FailsafeMode::brake, 100 * ns_per_ms);
  mode(FailsafeMode::land, 100 * ns_per_ms);
  flown.drones[0].phase = LinkPhase::landed;
  mode(FailsafeMode::none, 100 * ns_per_ms);
  mode(FailsafeMode::hold, 100 * ns_per_ms);
  const auto metrics = flown.metrics();
  EXPECT_EQ(metrics.at("holds"), 2);
  EXPECT_EQ(metrics.at("brakes"), 1);
  EXPECT_EQ(metrics.at("landings"), 1);
  EXPECT_NEAR(metrics.at("held_s"), 0.6, 1e-9);
}

TEST(Metrics, OfCommandsAreTheirAgeAndHowManyASecond) {
  Flown flown;
  for (int i = 0; i < 60; ++i) {
    flown.events = {{0, WorldEvent::Kind::applied, 0, i < 57 ? 0.08 : 0.2, {}, 1}};
    flown.pass(20 * ns_per_ms);
  }
  const auto metrics = flown.metrics();
  EXPECT_NEAR(metrics.at("command_age_median_ms"), 80, 2);
  EXPECT_NEAR(metrics.at("command_age_max_ms"), 200, 1e-6);
  EXPECT_NEAR(metrics.at("commands_hz"), 60 / 2.4, 1e-9) << "two drones fly 1.2 s";
}

TEST(Metrics, OfWhatADroneIsSentAreChangesOverTime) {
  Flown flown;
  for (int i = 0; i < 100; ++i) {
    flown.drones[0].sent = {0, i % 2 == 0 ? 0.1 : 0.0, 0};
    flown.drones[0].sent_ns = flown.now + ns_per_ms;
    flown.pass(50 * ns_per_ms);
  }
  EXPECT_NEAR(flown.metrics().at("sent_change_mps2"), 2, 1e-9);
}

TEST(Metrics, OfWhatWasNotThereAreNotThere) {
  MetricRecorder maker{Limits{}};
  const std::vector<DroneObservation> drones(1);
  Moment moment;
  moment.now = ns_per_ms;
  moment.drones = drones;
  maker.observe(moment);
  std::set<std::string_view> names;
  for (const MetricValue& metric : maker.finish(ns_per_ms)) names.insert(metric.name);
  for (const char* none : {"path_rms_m", "nearest_m", "command_age_median_ms", "commands_hz", "sent_change_mps2"})
    EXPECT_FALSE(names.contains(none)) << none;
}

}  // namespace
}  // namespace ledgerline::hil
