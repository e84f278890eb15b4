#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/unit/sim/flight.hpp"

namespace ledgerline::sim {
namespace {

double speed(const Truth& t) { return std::hypot(t.velocity_mps[0], t.velocity_mps[1]); }

TEST(Physics, ADroneThatIsOffStandsWhereItWasPut) {
  Parameters p;
  p.drones = 5;
  p.wind.gust_mps = 2;
  Flight flight(p);
  flight.run(5);
  for (DroneNumber k = 1; k <= 5; ++k) {
    const Truth t = flight.truth(k);
    EXPECT_NEAR(t.position_m[0], 3.0 * ((k - 1) % 4), 0.002);
    EXPECT_NEAR(t.position_m[1], 3.0 * ((k - 1) / 4), 0.002);
    EXPECT_NEAR(t.position_m[2], 0, 0.002);
    EXPECT_LT(t.tilt_rad, 0.01);
  }
}

TEST(Physics, TakeoffEndsAtTheConfiguredHeight) {
  Flight flight;
  ASSERT_EQ(flight.ask("command"), "ok");
  ASSERT_EQ(flight.ask("takeoff"), "ok");
  EXPECT_NEAR(flight.truth().position_m[2], 1.0, 0.06);
  flight.run(3);
  EXPECT_NEAR(flight.truth().position_m[2], 1.0, 0.02);
  EXPECT_TRUE(flight.truth().in_flight);
}

TEST(Physics, HoveringInGustsStaysNearItsPlace) {
  Parameters p;
  Flight flight(p);
  flight.take_off();
  double worst = 0, furthest_up = 0;
  for (int i = 0; i < 100; ++i) {
    if (i % 10 == 0) flight.ask("keepalive");
    flight.run(0.3);
    const Truth t = flight.truth();
    worst = std::max(worst, std::hypot(t.position_m[0], t.position_m[1]));
    furthest_up = std::max(furthest_up, std::abs(t.position_m[2] - 1));
  }
  EXPECT_LT(worst, 0.5);
  EXPECT_GT(worst, 0.001) << "gusts and sensor errors must show";
  EXPECT_LT(furthest_up, 0.1);
}

TEST(Physics, GustsPushADroneThatKnowsItsVelocityExactly) {
  const auto mean_speed = [](double gust_mps) {
    Parameters p = Flight::calm();
    p.wind.gust_mps = gust_mps;
    Flight flight(p);
    flight.take_off();
    double sum = 0;
    for (int i = 0; i < 100; ++i) {
      flight.run(0.1);
      sum += speed(flight.truth());
    }
    return sum / 100;
  };
  EXPECT_LT(mean_speed(0), 0.001);
  EXPECT_GT(mean_speed(0.1), 0.002);
  EXPECT_GT(mean_speed(1.0), 5 * mean_speed(0.1));
}

TEST(Physics, ASteadyWindPushesWhatFliesUntilItEnds) {
  Flight flight;
  flight.take_off();
  const double before = flight.truth().position_m[0];
  flight.simulator.set_wind({2, 0, 0});
  flight.run(0.5);
  EXPECT_GT(flight.truth().position_m[0], before + 0.005);
  flight.simulator.set_wind({});
  flight.run(5);
  EXPECT_NEAR(flight.truth().velocity_mps[0], 0, 0.02);
}

TEST(Physics, VelocityFollowsTheSticksAsAFirstOrderLag) {
  Flight flight;
  flight.take_off();
  flight.tell("rc 0 40 0 0");
  std::vector<double> speeds;
  for (int ms = 0; ms < 3000; ++ms) {
    flight.run(0.001);
    speeds.push_back(flight.truth().velocity_mps[0]);
  }
  const auto reached = std::find_if(speeds.begin(), speeds.end(), [](double v) { return v >= 0.632 * 0.4; });
  const auto lag_ms = reached - speeds.begin();
  // The model's lag of 300 ms plus the attitude loop's (2 / 22 rad/s = 91 ms).
  EXPECT_GT(lag_ms, 300);
  EXPECT_LT(lag_ms, 450);
  EXPECT_NEAR(speeds.back(), 0.4, 0.01);
  EXPECT_LT(*std::max_element(speeds.begin(), speeds.end()), 0.4 * 1.05) << "no overshoot";
}

TEST(Physics, AccelerationIsLimited) {
  Parameters p = Flight::calm();
  p.sdk.rc_full_mps = 3;
  Flight flight(p);
  flight.take_off();
  flight.tell("rc 0 100 0 0");
  double before = 0, most = 0;
  for (int i = 0; i < 200; ++i) {
    flight.run(0.01);
    most = std::max(most, (flight.truth().velocity_mps[0] - before) / 0.01);
    before = flight.truth().velocity_mps[0];
  }
  EXPECT_LT(most, p.control.max_acceleration_mps2 * 1.1);
  EXPECT_GT(most, p.control.max_acceleration_mps2 * 0.8);
}

TEST(Physics, SticksAreInTheDronesOwnFrame) {
  Flight flight;
  flight.take_off();
  ASSERT_EQ(flight.ask("ccw 90"), "ok");
  EXPECT_NEAR(flight.truth().yaw_rad, M_PI / 2, 0.05);
  flight.tell("rc 0 50 0 0");
  flight.run(2);
  EXPECT_NEAR(flight.truth().velocity_mps[1], 0.5, 0.03);
  flight.tell("rc 50 0 0 0");  // right of north is east
  flight.run(3);
  EXPECT_NEAR(flight.truth().velocity_mps[0], 0.5, 0.03);
  flight.tell("rc 0 0 30 0");
  flight.run(2);
  EXPECT_NEAR(flight.truth().velocity_mps[2], 0.3, 0.03);
  EXPECT_LT(speed(flight.truth()), 0.05);
}

TEST(Physics, LandingStopsTheMotorsOnTheGround) {
  Flight flight;
  flight.take_off();
  ASSERT_EQ(flight.ask("land"), "ok");
  const Truth t = flight.truth();
  EXPECT_FALSE(t.motors_on);
  EXPECT_FALSE(t.in_flight);
  EXPECT_FALSE(t.crashed);
  EXPECT_NEAR(t.position_m[2], 0, 0.005);
  EXPECT_LT(t.tilt_rad, 0.02);
  EXPECT_EQ(flight.ask("takeoff"), "ok") << "and it can fly again";
}

TEST(Physics, CutMotorsMeanAFallThatTheGroundStops) {
  Flight flight;
  flight.take_off();
  ASSERT_EQ(flight.ask("emergency"), "ok");
  flight.run(0.2);
  EXPECT_LT(flight.truth().velocity_mps[2], -1.0);
  flight.run(3);
  EXPECT_NEAR(flight.truth().position_m[2], 0, 0.05);
  EXPECT_LT(std::abs(flight.truth().velocity_mps[2]), 0.01);
}

TEST(Physics, DronesThatMeetPushEachOther) {
  Parameters p = Flight::calm();
  p.drones = 2;
  p.spacing_m = 1;
  Flight flight(p);
  flight.take_off(1);
  flight.take_off(2);
  flight.tell("rc 0 50 0 0", 1);
  double closest = 10, pushed = 0;
  for (int i = 0; i < 300; ++i) {
    flight.run(0.01);
    const Truth a = flight.truth(1), b = flight.truth(2);
    closest = std::min(closest, std::hypot(a.position_m[0] - b.position_m[0], a.position_m[1] - b.position_m[1],
                                           a.position_m[2] - b.position_m[2]));
    pushed = std::max(pushed, speed(b));
  }
  EXPECT_GT(closest, 0.03) << "bodies do not pass through each other";
  EXPECT_LT(closest, 0.26);
  EXPECT_GT(pushed, 0.1);
}

TEST(Physics, ADroneThatIsTurnedOverStopsItsMotors) {
  Parameters p = Flight::calm();
  p.control.crash_tilt_rad = 0.2;
  p.sdk.rc_full_mps = 3;
  Flight flight(p);
  flight.take_off();
  flight.tell("rc 0 100 0 0");
  flight.run(3);
  EXPECT_TRUE(flight.truth().crashed);
  EXPECT_FALSE(flight.truth().motors_on);
  EXPECT_EQ(flight.ask("forward 50"), "error Motor stop");
}

TEST(Physics, AFlipTurnsOnceRoundAndFliesOn) {
  for (const char* direction : {"f", "b", "l", "r"}) {
    Flight flight;
    flight.take_off();
    flight.ask("up 50");
    flight.tell(std::string("flip ") + direction);
    double max_tilt = 0, lowest = 10, highest = 0;
    for (int i = 0; i < 450; ++i) {
      flight.run(0.01);
      max_tilt = std::max(max_tilt, flight.truth().tilt_rad);
      lowest = std::min(lowest, flight.truth().position_m[2]);
      highest = std::max(highest, flight.truth().position_m[2]);
    }
    EXPECT_EQ(flight.answers.back().bytes, "ok") << direction;
    EXPECT_GT(max_tilt, 2.8) << direction;
    EXPECT_GT(lowest, 0.5) << direction;
    EXPECT_LT(highest, 2.2) << direction;
    EXPECT_NEAR(flight.truth().position_m[0], 0, 0.15) << direction;
    EXPECT_NEAR(flight.truth().position_m[1], 0, 0.15) << direction;
    EXPECT_NEAR(flight.truth().position_m[2], 1.5, 0.1) << direction;
    EXPECT_TRUE(flight.truth().in_flight) << direction;
    EXPECT_LT(speed(flight.truth()), 0.1) << direction;
  }
}

TEST(Physics, TheBatteryEmptiesInThirteenMinutesOfFlightAndTheDroneLandsBefore) {
  Parameters p = Flight::calm();
  p.battery.start = 0.10;
  p.mocap_hz = 0;
  Flight flight(p);
  flight.take_off();
  const double before = flight.truth().battery;
  flight.run(10);
  const double below_sag = (1 - p.battery.sag_below) * p.battery.sag_factor + p.battery.sag_below;
  EXPECT_NEAR(before - flight.truth().battery, below_sag * 10.0 / 780, 1e-4);
  for (int i = 0; i < 8; ++i) {
    flight.ask("keepalive");
    flight.run(5);
  }
  EXPECT_FALSE(flight.truth().motors_on);
  EXPECT_EQ(flight.ask("takeoff"), "error");
}

TEST(Physics, MocapComesAtItsRateWithItsNoise) {
  Parameters p;
  p.drones = 2;
  p.mocap_hz = 120;
  Flight flight(p);
  flight.run(2);
  EXPECT_NEAR(static_cast<double>(flight.poses.size()), 2 * 2 * 120, 2);
  double sum = 0, squares = 0, count = 0;
  for (const MocapPose& pose : flight.poses)
    if (pose.drone == 2) {
      sum += pose.position_m[0] - 3;
      squares += std::pow(pose.position_m[0] - 3, 2);
      ++count;
    }
  EXPECT_NEAR(sum / count, 0, 0.0002);
  EXPECT_NEAR(std::sqrt(squares / count), p.sensors.mocap_m, 0.0001);
}

std::string a_whole_flight(std::uint64_t seed) {
  Parameters p;
  p.drones = 3;
  p.seed = seed;
  Flight flight(p);
  for (DroneNumber k = 1; k <= 3; ++k) flight.ask("command", 1, k);
  for (DroneNumber k = 1; k <= 3; ++k) flight.tell("takeoff", k);
  flight.run(6);
  flight.tell("rc 10 30 0 20", 1);
  flight.tell("go 100 50 20 60", 2);
  flight.tell("flip l", 3);
  flight.run(4);
  for (DroneNumber k = 1; k <= 3; ++k) flight.tell("land", k);
  flight.run(5);
  return flight.bytes;
}

TEST(Physics, TheSameSeedGivesTheSameBytesAndAnotherDoesNot) {
  const std::string first = a_whole_flight(1);
  EXPECT_GT(first.size(), 100'000u);
  EXPECT_TRUE(first == a_whole_flight(1));
  EXPECT_FALSE(first == a_whole_flight(2));
}

TEST(Physics, TheSensorsNoiseComesFromTheSeedToo) {
  const auto on_the_ground = [](std::uint64_t seed) {
    Parameters p;
    p.seed = seed;
    Flight flight(p);
    flight.run(0.5);
    return flight.bytes;
  };
  EXPECT_FALSE(on_the_ground(1) == on_the_ground(2));
}

TEST(Physics, HowOftenStepIsCalledChangesNothing) {
  Flight often{Parameters{}};
  Simulator seldom(Parameters{}, 0);
  often.run(1);
  std::string bytes;
  for (TimeNs now = 0; now <= ns_per_s; now += 50 * ns_per_ms)
    for (const MocapPose& pose : seldom.step(now).poses) {
      bytes.append(reinterpret_cast<const char*>(pose.position_m.data()), sizeof pose.position_m);
      bytes.append(reinterpret_cast<const char*>(pose.orientation.data()), sizeof pose.orientation);
    }
  EXPECT_TRUE(often.bytes == bytes);
}

}  // namespace
}  // namespace ledgerline::sim
