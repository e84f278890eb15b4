#include "onboard/link/core/tello/tello_text.hpp"

#include <gtest/gtest.h>

#include <string>

#include "common/base/random.hpp"

namespace ledgerline::link {
namespace {

const std::string real_state =
    "mid:-1;x:-100;y:-100;z:-100;mpry:-1,-1,-1;pitch:0;roll:-1;yaw:-12;vgx:0;vgy:0;vgz:-1;templ:85;temph:88;tof:81;h:"
    "70;"
    "bat:64;baro:-102.87;time:11;agx:-5.00;agy:7.00;agz:-999.00;\r\n";

TEST(TelloText, ARealStatePacketIsReadInMetresAndShares) {
  TelloState state;
  ASSERT_TRUE(parse_state(real_state, state));
  EXPECT_FLOAT_EQ(state.height_m, 0.7F);
  EXPECT_FLOAT_EQ(state.tof_m, 0.81F);
  EXPECT_FLOAT_EQ(state.battery, 0.64F);
  EXPECT_EQ(state.attitude_deg, (std::array<float, 3>{-1, 0, -12}));
  EXPECT_EQ(state.acceleration_mg, (std::array<float, 3>{-5, 7, -999}));
}

TEST(TelloText, APacketOfSdk13WithoutPadsIsReadToo) {
  TelloState state;
  EXPECT_TRUE(parse_state("mid:257;pitch:0;roll:0;yaw:0;tof:10;h:0;bat:100;\r\n", state));
  EXPECT_EQ(state.pad, -2);
  EXPECT_FALSE(state.has_velocity);
  EXPECT_FALSE(state.has_barometer);
}

TEST(TelloText, VelocitiesBarometerAndPadAreOfTheNewestPacketAlone) {
  TelloState state;
  ASSERT_TRUE(parse_state("mid:3;x:-12;y:40;z:95;mpry:1,2,-90;vgx:-7;vgy:2;vgz:1;tof:10;h:0;bat:9;baro:147.94;time:12;",
                          state));
  EXPECT_TRUE(state.has_velocity);
  EXPECT_EQ(state.velocity_dmps, (std::array<float, 3>{-7, 2, 1}));
  EXPECT_TRUE(state.has_barometer);
  EXPECT_FLOAT_EQ(state.barometer_m, 147.94F);
  EXPECT_EQ(state.motor_s, 12);
  EXPECT_EQ(state.pad, 3);
  EXPECT_EQ(state.on_pad_m, (std::array<float, 3>{-0.12F, 0.4F, 0.95F}));
  EXPECT_FLOAT_EQ(state.on_pad_yaw_deg, -90);
  ASSERT_TRUE(parse_state("vgx:1;vgy:x;vgz:1;tof:10;h:0;bat:9;", state));
  EXPECT_FALSE(state.has_velocity);
  EXPECT_FALSE(state.has_barometer);
  EXPECT_EQ(state.pad, -2);
  ASSERT_TRUE(parse_state("mid:9;mpry:;vgx:5000;vgy:1;vgz:1;tof:10;h:0;bat:9;", state));
  EXPECT_FALSE(state.has_velocity);
  EXPECT_EQ(state.pad, -2);
}

TEST(TelloText, TheHotterOneOfItsTemperaturesCounts) {
  TelloState state;
  ASSERT_TRUE(parse_state("templ:83;temph:86;tof:10;h:0;bat:50;", state));
  EXPECT_EQ(state.temperature_c, 86);
  ASSERT_TRUE(parse_state("templ:70;temph:72;tof:10;h:0;bat:50;", state));
  EXPECT_EQ(state.temperature_c, 72);
  ASSERT_TRUE(parse_state("templ:900;temph:-;tof:10;h:0;bat:50;", state));
  EXPECT_EQ(state.temperature_c, 72) << "what cannot be leaves the one before";
}

TEST(TelloText, AnAttitudeOrAccelerationThatCannotBeLeavesTheOneBefore) {
  TelloState state;
  ASSERT_TRUE(parse_state(real_state, state));
  ASSERT_TRUE(parse_state("pitch:361;roll:nan;yaw:-5;agx:1e9;agy:inf;agz:-900.5;tof:10;h:0;bat:100;\r\n", state));
  EXPECT_EQ(state.attitude_deg, (std::array<float, 3>{-1, 0, -5}));
  EXPECT_EQ(state.acceleration_mg, (std::array<float, 3>{-5, 7, -900.5F}));
}

TEST(TelloText, APacketWithoutBatteryHeightOrTofLeavesTheStateAsItWas) {
  TelloState state;
  ASSERT_TRUE(parse_state(real_state, state));
  for (const char* bad :
       {"", "ok", ";;;;", "h:10;tof:10;", "h:10;bat:50;", "tof:10;bat:50;", "h:;tof:10;bat:50;", "h:nan;tof:10;bat:50;",
        "h:inf;tof:10;bat:50;", "h:1e99;tof:10;bat:50;", "h:10;tof:-5;bat:50;", "h:10;tof:10;bat:101;",
        "h:10;tof:10;bat:5x;", "h :10;tof:10;bat:50"}) {
    EXPECT_FALSE(parse_state(bad, state)) << bad;
    EXPECT_FLOAT_EQ(state.battery, 0.64F) << bad;
  }
}

TEST(TelloText, AFieldThatIsTornIsNotRead) {
  TelloState state;
  ASSERT_TRUE(parse_state(real_state, state));
  EXPECT_FALSE(parse_state("tof:10;h:0;bat:1", state));  // of 100
  EXPECT_FLOAT_EQ(state.battery, 0.64F);
  ASSERT_TRUE(parse_state("tof:10;h:0;bat:100;baro:14", state));
  EXPECT_FALSE(state.has_barometer);
}

TEST(TelloText, AnyBytesAreSafeAndNeverGiveAnInvalidState) {
  Random random(7);
  for (int round = 0; round < 20'000; ++round) {
    std::string bytes = real_state;
    const int changes = 1 + static_cast<int>(random.next() % 20);
    for (int i = 0; i < changes; ++i) bytes[random.next() % bytes.size()] = static_cast<char>(random.next());
    bytes.resize(random.next() % (bytes.size() + 1));
    TelloState state;
    if (!parse_state(bytes, state)) continue;
    EXPECT_GE(state.battery, 0);
    EXPECT_LE(state.battery, 1);
    EXPECT_GE(state.tof_m, 0);
    EXPECT_LE(state.tof_m, 100);
    EXPECT_LE(std::abs(state.height_m), 200);
  }
}

TEST(TelloText, OkIsOkAloneAndWordsThatContainItAreNot) {
  for (const char* text : {"ok", "OK", "ok\r\n", "Ok "}) EXPECT_EQ(parse_answer(text), Answer::ok) << text;
  for (const char* text : {"revoked", "token", "okay", "o", "", "100", "\xff\xfeok"}) {
    EXPECT_EQ(parse_answer(text), Answer::unknown) << text;
  }
  for (const char* text : {"error", "error Motor stop", "Error: x", "out of range", "unknown command: rc"}) {
    EXPECT_EQ(parse_answer(text), Answer::refused) << text;
  }
}

TEST(TelloText, RcIsWrittenInTheSdksOrderAndWithinItsRange) {
  EXPECT_EQ(rc_text({1, -2, 30, 0}).view(), "rc 1 -2 30 0");
  EXPECT_EQ(rc_text({-100, -100, -100, -100}).view(), "rc -100 -100 -100 -100");
  EXPECT_EQ(rc_text({2147483647, -2147483647, 101, -101}).view(), "rc 100 -100 100 -100");
}

}  // namespace
}  // namespace ledgerline::link
