#include "hil/fault/real/real_faults.hpp"

#include <gtest/gtest.h>

#include <filesystem>

namespace ledgerline::hil {
namespace {

/// The folder of a flight whose traces grow.
class LiveObservationTest : public testing::Test {
 protected:
  LiveObservationTest() { std::filesystem::create_directories(run_); }
  ~LiveObservationTest() override { std::filesystem::remove_all(run_); }
  void write(const std::string& name, const std::vector<TraceRecord>& records) {
    auto writer = TraceWriter::create(run_ + "/" + name);
    ASSERT_TRUE(writer) << writer.error().message;
    for (const TraceRecord& record : records) writer->add(record);
  }
  std::string run_ = testing::TempDir() + "ledgerline_live_observation";
  Script script_;
};

TEST_F(LiveObservationTest, WithoutTracesNothingHasBegun) {
  LiveObservation live(run_, script_);
  live.read();
  EXPECT_EQ(live.begin_ns(), 0);
  ASSERT_EQ(live.drones().size(), 1U);
  EXPECT_EQ(live.drones()[0].name, "tello1");
}

TEST_F(LiveObservationTest, SaysWhereADroneIsInWhichPhaseAndLap) {
  LiveObservation live(run_, script_);
  TraceRecord truth{.t_ns = 5, .kind = TraceKind::truth, .drone = 1, .extra = 1};
  truth.v[2] = 0.75;
  TraceRecord made{.t_ns = 6, .kind = TraceKind::command_made, .drone = 1};
  made.v[3] = 1.5 * ground::Path(script_.flight.shape, {0, 0}, script_.flight.side_m).length_m();
  write("sim.trace", {truth});
  write("link.trace",
        {{.t_ns = 4, .kind = TraceKind::mode, .drone = 1, .id = static_cast<std::uint64_t>(LinkPhase::flying)}});
  write("ground.trace", {made});
  live.read();
  const DroneObservation& drone = live.drones()[0];
  EXPECT_EQ(live.begin_ns(), 4);
  EXPECT_TRUE(drone.truth.in_flight);
  EXPECT_DOUBLE_EQ(drone.truth.position_m[2], 0.75);
  EXPECT_EQ(drone.phase, LinkPhase::flying);
  EXPECT_EQ(drone.ground_phase, ground::GroundPhase::path);
  EXPECT_EQ(drone.lap, 2);
}

}  // namespace
}  // namespace ledgerline::hil
