#include "onboard/link/shell/link_config.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "common/msg/contract.hpp"

namespace ledgerline::link {
namespace {

class LinkConfig : public ::testing::Test {
 protected:
  Result<ShellSettings> load(const std::string& toml) {
    const std::string path = ::testing::TempDir() + "link_config_test_" + std::to_string(::getpid()) + ".toml";
    std::ofstream(path) << toml;
    auto settings = load_settings(path);
    ::unlink(path.c_str());
    return settings;
  }
  const std::string drone = "[[drone]]\nname = \"tello1\"\nnumber = 3\naddress = \"127.0.0.2\"\n";
};

TEST_F(LinkConfig, OneDroneIsEnough) {
  const auto settings = load(drone);
  ASSERT_TRUE(settings) << settings.error().message;
  ASSERT_EQ(settings->link.drones.size(), 1U);
  EXPECT_EQ(settings->link.drones[0].name, "tello1");
  EXPECT_EQ(settings->link.drones[0].number, 3);
  EXPECT_EQ(ntohl(settings->addresses[0].sin_addr.s_addr), 0x7F000002U);
  EXPECT_EQ(ntohs(settings->addresses[0].sin_port), 8889);
  EXPECT_EQ(settings->link.rate_hz, 30);
  EXPECT_EQ(settings->link.failsafe.land_after_ns, FailsafeSettings{}.land_after_ns);
}

TEST_F(LinkConfig, ThresholdsAreReadInTheirUnits) {
  const auto settings =
      load(drone +
           "[state]\nrate_hz = 50.0\nlisten = \"127.0.0.1:9000\"\n[limits]\nspeed_mps = 0.7\n"
           "[failsafe]\nland_after_s = 2.5\npose_lost_ms = 250\non_untrusted_ledger = \"hold\"\n[fence]\nmax_m = [1.0, "
           "2.0, 3.0]\n"
           "[realtime]\npriority = 0\ncpu = 1\n[rc]\nsigns = [1, 1, 1, 1]\n[output]\nstarts = \"x\"\n");
  ASSERT_TRUE(settings) << settings.error().message;
  EXPECT_EQ(settings->link.rate_hz, 50);
  EXPECT_EQ(ntohs(settings->state_listen.sin_port), 9000);
  EXPECT_FLOAT_EQ(settings->link.playout.max_speed_mps, 0.7F);
  EXPECT_EQ(settings->link.failsafe.land_after_ns, 2500 * ns_per_ms);
  EXPECT_EQ(settings->link.failsafe.pose_lost_ns, 250 * ns_per_ms);
  EXPECT_EQ(settings->link.failsafe.on_untrusted_ledger, OnUntrustedLedger::hold);
  EXPECT_EQ(settings->link.fence.max_m[1], 2);
  EXPECT_EQ(settings->link.rc.signs[0], 1);
  EXPECT_EQ(settings->priority, 0);
  EXPECT_EQ(settings->starts, "x");
}

TEST_F(LinkConfig, TheSourceOfThePoseIsGivenForAllAndForOne) {
  const auto settings =
      load("[pose]\nsource = \"tello\"\nvelocity_signs = [-1, 1, -1]\nvelocity_frame = \"body\"\n" + drone +
           "start_m = [1.0, 2.0, 0.0]\nstart_yaw_rad = 1.5\n[[drone]]\nname = \"tello2\"\naddress = "
           "\"127.0.0.3\"\npose_source = \"pads\"\n[[pad]]\nid = 3\nposition_m = [0.5, 0.5, 0.0]\nyaw_rad = 0.2\n");
  ASSERT_TRUE(settings) << settings.error().message;
  const auto& drones = settings->link.drones;
  EXPECT_EQ(drones[0].source, PoseSource::tello);
  EXPECT_EQ(drones[0].odometry.start_m[1], 2);
  EXPECT_TRUE(drones[0].by_hand_without_pose);
  EXPECT_FALSE(load(drone)->link.drones[0].by_hand_without_pose);
  EXPECT_EQ(drones[0].odometry.start_yaw_rad, 1.5);
  EXPECT_EQ(drones[1].source, PoseSource::pads);
  EXPECT_TRUE(drones[1].odometry.velocity_in_body);
  EXPECT_EQ(drones[1].odometry.velocity_signs, (std::array<float, 3>{-1, 1, -1}));
  ASSERT_EQ(settings->link.pads.size(), 1U);
  EXPECT_EQ(settings->link.pads[0].id, 3);
  EXPECT_EQ(settings->link.pads[0].position_m[0], 0.5);
}

TEST_F(LinkConfig, RealDronesAreNotFlownWithoutAFence) {
  const auto why_not = [&](const std::string& toml) {
    const auto settings = load(toml);
    return settings ? std::string() : settings.error().message;
  };
  const std::string real = "[[drone]]\nname = \"tello1\"\naddress = \"192.168.10.1\"\n";
  const std::string low = "min_m = [-2, -2, 0]\n", high = "max_m = [2, 2, 2]\n";
  for (const std::string& without : {std::string(), "[fence]\n" + low, "[fence]\n" + high}) {
    EXPECT_NE(why_not(real + without).find("real drones are not flown without a fence"), std::string::npos) << without;
    EXPECT_EQ(why_not(drone + without), "") << "a simulated one keeps the default";
  }
  EXPECT_EQ(why_not(real + "[fence]\n" + low + high), "");
  // Several real ones have the loopback's address of nobody, behind interfaces of their own.
  EXPECT_NE(why_not(drone + "interface = \"wlan1\"\n").find("without a fence"), std::string::npos);
  // Through shared memory there are simulated ones alone.
  EXPECT_EQ(why_not("[tello]\ntransport = \"shim\"\n[shim]\nmemory = \"/dev/shm/x\"\n" + real), "");
}

TEST_F(LinkConfig, WhatWouldFlyADroneAwayHasNoDefault) {
  const auto why_not = [&](const std::string& toml) {
    const auto settings = load(toml);
    return settings ? std::string() : settings.error().message;
  };
  const std::string signs = "velocity_signs = [1, 1, 1]\n", pad = "[[pad]]\nid = 1\nposition_m = [0, 0, 0]\n";
  EXPECT_NE(why_not("[pose]\nsource = \"tello\"\n" + drone).find("pose.velocity_signs"), std::string::npos);
  EXPECT_NE(why_not("[pose]\nsource = \"pads\"\n" + signs + drone).find("needs a [[pad]]"), std::string::npos);
  EXPECT_NE(why_not("[pose]\nsource = \"pads\"\n" + signs + drone + pad + pad).find("two [[pad]] have id 1"),
            std::string::npos);
  EXPECT_NE(why_not(drone + pad).find("no drone has it"), std::string::npos);
  EXPECT_NE(why_not("[pose]\nsource = \"pads\"\n" + signs + drone + "[[pad]]\nid = 1\n").find("position_m"),
            std::string::npos);
  EXPECT_EQ(why_not("[pose]\nsource = \"pads\"\n" + signs + drone + pad), "");
}

TEST_F(LinkConfig, TwoDronesThatFlyByOdometryFromOnePlaceAreRefused) {
  const std::string own = "[pose]\nsource = \"tello\"\nvelocity_signs = [1, 1, 1]\n" + drone;
  const std::string second = "[[drone]]\nname = \"tello2\"\naddress = \"127.0.0.3\"\n";
  const auto refused = load(own + second);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("drones tello1 and tello2 fly by onboard odometry from one place"),
            std::string::npos)
      << refused.error().message;
  EXPECT_TRUE(load(own + second + "start_m = [1.0, 0.0, 0.0]\n"));
  EXPECT_TRUE(load(own + second + "common_frame = false\n"));
}

TEST_F(LinkConfig, MistakesAreNamed) {
  const auto error_of = [&](const std::string& toml) {
    const auto settings = load(toml);
    return settings ? std::string() : settings.error().message;
  };
  EXPECT_NE(error_of("").find("[[drone]]"), std::string::npos);
  EXPECT_NE(error_of(drone + "[failsave]\nland_after_s = 1\n").find("failsave"), std::string::npos);
  EXPECT_NE(error_of(drone + "[fence]\nmin_m = [1.0, 0.0, 0.0]\nmax_m = [1.0, 2.0, 3.0]\n").find("fence.min_m"),
            std::string::npos);
  EXPECT_NE(error_of(drone + "[fence]\nmin_m = [nan, 0.0, 0.0]\n").find("fence.min_m"), std::string::npos);
  EXPECT_NE(error_of(drone + drone).find("number 3"), std::string::npos);
  EXPECT_NE(error_of(drone + "[state]\nlisten = \"localhost:1\"\n").find("state.listen"), std::string::npos);
  EXPECT_NE(error_of(drone + "[state]\nlisten = \"0.0.0.0:0\"\n").find("state.listen"), std::string::npos);
  EXPECT_NE(error_of("[[drone]]\nname = \"tello1\"\naddress = \"tello.local\"\n").find("tello1"), std::string::npos);
}

TEST_F(LinkConfig, ADroneHasANameThatRosTakes) {
  for (const char* name : {"1tello", "tello-1", "tello__1"}) {
    const auto refused = load("[[drone]]\nname = \"" + std::string(name) + "\"\naddress = \"192.168.10.1\"\n");
    ASSERT_FALSE(refused) << name;
    EXPECT_NE(refused.error().message.find("drone.0.name: " + std::string(contract::drone_name_rule)),
              std::string::npos)
        << refused.error().message;
  }
}

TEST_F(LinkConfig, DronesWithOneAddressNeedInterfacesOfTheirOwn) {
  const auto two = [&](const std::string& first, const std::string& second) {
    const std::string same = "\naddress = \"192.168.10.1\"\n";
    const auto settings = load("[fence]\nmin_m = [-2, -2, 0]\nmax_m = [2, 2, 2]\n[[drone]]\nname = \"a\"" + same +
                               first + "\n[[drone]]\nname = \"b\"" + same + second + "\n");
    return settings ? settings->interfaces[0] + " " + settings->interfaces[1] : settings.error().message;
  };
  const std::string wlan0 = "interface = \"wlan0\"", wlan1 = "interface = \"wlan1\"";
  EXPECT_EQ(two(wlan0, wlan1), "wlan0 wlan1");
  for (const std::string& error : {two("", ""), two(wlan0, wlan0), two(wlan0, ""), two("", wlan1)}) {
    EXPECT_NE(error.find("two drones have address 192.168.10.1"), std::string::npos) << error;
  }
  EXPECT_NE(two(wlan0, "interface = \"a-name-of-16-let\"").find("interface"), std::string::npos);
}

TEST_F(LinkConfig, ASerialIsAlphanumeric) {
  const auto settings = load(drone + "serial = \"0TQDG00EDPMV39\"\n[tello]\ncommand_port = 9999\n");
  ASSERT_TRUE(settings) << settings.error().message;
  EXPECT_EQ(settings->link.drones[0].serial, "0TQDG00EDPMV39");
  EXPECT_EQ(settings->state_port, 9999);  // as the command port, unless it is named
  for (const char* serial : {"x", "0TQDG00 EDPMV39", "0TQDG00EDPMV390TQDG00EDPMV39"}) {
    const auto refused = load(drone + "serial = \"" + serial + "\"\n");
    ASSERT_FALSE(refused) << serial;
    EXPECT_NE(refused.error().message.find("tello1"), std::string::npos) << refused.error().message;
  }
}

TEST_F(LinkConfig, AnOrderOfTimesThatTheFailsafeCannotKeepIsRefused) {
  const auto error_of = [&](const std::string& keys) {
    const auto settings = load(drone + "[failsafe]\n" + keys);
    return settings ? std::string() : settings.error().message;
  };
  const auto names = [](const std::string& error, const char* one, const char* other) {
    return error.find(one) != std::string::npos && error.find(other) != std::string::npos;
  };
  for (const char* key : {"agent_silent_ms", "state_stale_ms", "pose_lost_ms"}) {
    const std::string error = error_of(std::string(key) + " = 1001\n");
    EXPECT_TRUE(names(error, "failsafe.clear_after_ms", key)) << error;
    EXPECT_EQ(error_of(std::string(key) + " = 1000\n"), "");
    EXPECT_EQ(error_of(std::string(key) + " = 3000\nclear_after_ms = 1500\n"), "");
  }
  EXPECT_TRUE(names(error_of("land_after_s = 0.5\n"), "failsafe.land_after_s", "failsafe.clear_after_ms"));
  EXPECT_EQ(error_of("land_after_s = 0.51\n"), "");
  EXPECT_TRUE(names(error_of("battery_critical = 0.15\n"), "failsafe.battery_critical", "failsafe.battery_low"));
  EXPECT_NE(error_of("battery_low = 0.0\nbattery_critical = 0.0\n").find("0.01"), std::string::npos);
  EXPECT_EQ(error_of("battery_low = 0.01\nbattery_critical = 0.0\n"), "");
  EXPECT_NE(error_of("battery_low = 0.97\n").find("failsafe.battery_low"), std::string::npos);
  EXPECT_NE(error_of("agent_silent_ms = 200\n").find("failsafe.agent_silent_ms"), std::string::npos);
  EXPECT_NE(error_of("state_stale_ms = 200\n").find("failsafe.state_stale_ms"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::link
