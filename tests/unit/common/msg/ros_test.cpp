#include "common/msg/ros.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <map>
#include <numbers>
#include <sstream>

#include "common/base/enum_count.hpp"
#include "common/base/random.hpp"
#include "common/msg/cdr.hpp"
#include "common/msg/names.hpp"

namespace ledgerline {
namespace {

Odometry sample_odometry() {
  Odometry odometry;
  odometry.header = {1'700'000'000'123'456'789, "map"};
  odometry.child_frame_id = "tello1";
  odometry.position_m = {1.5, -2.25, 1};
  odometry.orientation = {0, 0, 0.5, 0.75};
  odometry.linear_mps = {0.5, 0.25, -0.125};
  odometry.angular_radps = {0, 0, 2};
  return odometry;
}

TEST(Ros, OdometryComesBack) {
  const Odometry wanted = sample_odometry();
  const Odometry got = odometry_from_cdr(to_cdr(wanted)).value();
  EXPECT_EQ(got.header.stamp_ns, wanted.header.stamp_ns);
  EXPECT_EQ(got.header.frame_id, "map");
  EXPECT_EQ(got.child_frame_id, "tello1");
  EXPECT_EQ(got.position_m, wanted.position_m);
  EXPECT_EQ(got.orientation, wanted.orientation);
  EXPECT_EQ(got.linear_mps, wanted.linear_mps);
  EXPECT_EQ(got.angular_radps, wanted.angular_radps);
}

TEST(Ros, TheAngularVelocityOfAStateIsMarkedAsNotMeasured) {
  const Odometry got = odometry_from_cdr(to_cdr(odometry_of(StateSample{}, "tello1", 0))).value();
  EXPECT_EQ(got.angular_radps, (std::array<double, 3>{}));
  for (const float variance : got.angular_variance) EXPECT_GE(variance, 1e6F);
}

std::string hex(const std::string& bytes) {
  std::string out;
  for (const char c : bytes) {
    out.push_back("0123456789abcdef"[static_cast<unsigned char>(c) >> 4]);
    out.push_back("0123456789abcdef"[c & 15]);
  }
  return out;
}

// Written by PyPI's rosbags (types of ROS 2 Humble) for the same values, covariances zero.
TEST(Ros, OdometryHasTheBytesOfAnIndependentWriter) {
  EXPECT_EQ(hex(to_cdr(sample_odometry())),
            "0001000000f1536515cd5b07040000006d6170000700000074656c6c6f31000000000000000000000000f83f000000000000"
            "02c0000000000000f03f00000000000000000000000000000000000000000000e03f000000000000e83f0000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "000000000000000000000000000000000000000000000000000000000000000000000000e03f000000000000d03f00000000"
            "0000c0bf00000000000000000000000000000000000000000000004000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "00000000000000000000000000000000");
}

TEST(Ros, PoseHasTheBytesOfAnIndependentWriter) {
  const PoseStamped pose{{5 * ns_per_s + 7, "map"}, {1.5, -2.25, 1}, {0, 0, 0.5, 0.75}};
  EXPECT_EQ(hex(to_cdr(pose)),
            "000100000500000007000000040000006d617000000000000000f83f00000000000002c0000000000000f03f000000000000"
            "00000000000000000000000000000000e03f000000000000e83f");
}

TEST(Ros, TransformsHaveTheBytesOfAnIndependentWriter) {
  const std::vector<TransformStamped> transforms{
      {{5 * ns_per_s + 7, "map"}, "tello1/base_link", {1.5, -2.25, 1}, {0, 0, 0.5, 0.75}},
      {{6 * ns_per_s + 8, "map"}, "tello12", {0, 0, 3}, {0, 0, 0, 1}}};
  EXPECT_EQ(hex(to_cdr(transforms)),
            "00010000020000000500000007000000040000006d6170001100000074656c6c6f312f626173655f6c696e6b000000000000"
            "0000000000000000f83f00000000000002c0000000000000f03f00000000000000000000000000000000000000000000e03f"
            "000000000000e83f0600000008000000040000006d6170000800000074656c6c6f3132000000000000000000000000000000"
            "0000000000000000000000000840000000000000000000000000000000000000000000000000000000000000f03f");
}

TEST(Ros, ImuHasTheBytesOfAnIndependentWriter) {
  const Imu imu{{5 * ns_per_s + 7, "tello1/base_link"}, {0, 0, 0.5, 0.75}, {0.5, -0.25, 9.75}};
  EXPECT_EQ(hex(to_cdr(imu)),
            "0001000005000000070000001100000074656c6c6f312f626173655f6c696e6b000000000000000000000000000000000000"
            "0000000000000000e03f000000000000e83f0000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000f0bf00000000000000000000000000000000000000000000000000000000"
            "000000000000000000000000000000000000000000000000000000000000000000000000000000000000e03f000000000000"
            "d0bf000000000080234000000000000000000000000000000000000000000000000000000000000000000000000000000000"
            "0000000000000000000000000000000000000000000000000000000000000000");
}

TEST(Ros, ATwistOfAnIndependentWriterIsRead) {
  const std::string wanted =
      "00010000000000000000e03f000000000000d0bf000000000000c03f000000000000f03f0000000000000040000000000000"
      "08c0";
  std::string bytes;
  for (std::size_t i = 0; i < wanted.size(); i += 2)
    bytes.push_back(static_cast<char>(std::stoi(wanted.substr(i, 2), nullptr, 16)));
  const Twist twist = twist_from_cdr(bytes).value();
  EXPECT_EQ(twist.linear_mps, (std::array<double, 3>{0.5, -0.25, 0.125}));
  EXPECT_EQ(twist.angular_radps, (std::array<double, 3>{1, 2, -3}));
  for (std::size_t cut = 0; cut < bytes.size(); ++cut) ASSERT_FALSE(twist_from_cdr(bytes.substr(0, cut))) << cut;
}

TEST(Ros, BatteryHasTheBytesOfAnIndependentWriter) {
  EXPECT_EQ(hex(to_cdr(BatteryState{{5 * ns_per_s, "tello1"}, 3.75F, 0.5F})),
            "0001000005000000000000000700000074656c6c6f310000000070400000c07f0000c07f0000c07f0000c07f0000c07f0000"
            "003f02000301000000000000000001000000000000000100000000");
}

TEST(Ros, BatteryComesBack) {
  const BatteryState got = battery_from_cdr(to_cdr(BatteryState{{5 * ns_per_s, "tello1"}, 3.75F, 0.5F})).value();
  EXPECT_EQ(got.header.stamp_ns, 5 * ns_per_s);
  EXPECT_EQ(got.voltage_v, 3.75F);
  EXPECT_EQ(got.percentage, 0.5F);
}

StateSample sample_status() {
  StateSample s;
  s.phase = LinkPhase::flying;
  s.mode = FailsafeMode::hold;
  s.cause = FailsafeCause::plan_ran_out;
  s.boot_id = 0x0123456789abcdef;
  s.sequence = 42;
  s.stamp_ns = 1'000'000'007;
  s.pose_stamp_ns = 999'999'999;
  s.position_m = {1, 2, 3};
  s.velocity_mps = {4, 5, 6};
  s.yaw_rad = -0.5;
  s.battery = 0.25F;
  s.tof_m = 1.25F;
  s.height_m = 1.5F;
  s.sdk_state_fresh = true;
  s.applied_sequence = 41;
  s.playout_margin_ns = 30'000'000;
  s.arrived_sequence = 43;
  s.arrived_ns = 995'000'000;
  s.sent_velocity_mps = {0.5F, -0.5F, 0.25F};
  s.sent_yaw_rate_radps = 0.125F;
  s.attitude_rad = {0.25F, -0.5F, 1.5F};
  s.acceleration_mps2 = {0.5F, -0.25F, 9.75F};
  s.pose_variance = {0.25F, 0.5F, 0.125F, 0.0625F};
  return s;
}

constexpr TimeNs real_offset_ns = 1'700'000'000'123'456'789;

Result<DroneState> there_and_back(const StateSample& s) {
  return state_from_cdr(link_status_to_cdr(s, real_offset_ns), to_cdr(odometry_of(s, "tello1", real_offset_ns)));
}

TEST(Ros, AStateComesBackWholeOutOfItsMessages) {
  const StateSample wanted = sample_status();
  const DroneState state = there_and_back(wanted).value();
  const StateSample& got = state.sample;
  EXPECT_EQ(state.real_ns, wanted.stamp_ns + real_offset_ns);
  EXPECT_EQ(got.phase, wanted.phase);
  EXPECT_EQ(got.mode, wanted.mode);
  EXPECT_EQ(got.cause, wanted.cause);
  EXPECT_EQ(got.boot_id, wanted.boot_id);
  EXPECT_EQ(got.sequence, wanted.sequence);
  EXPECT_EQ(got.stamp_ns, wanted.stamp_ns);
  EXPECT_EQ(got.pose_stamp_ns, wanted.pose_stamp_ns);
  EXPECT_EQ(got.position_m, wanted.position_m);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(got.velocity_mps[i], wanted.velocity_mps[i], 1e-12) << i;
  EXPECT_NEAR(got.yaw_rad, wanted.yaw_rad, 1e-12);
  EXPECT_EQ(got.pose_variance, wanted.pose_variance);
  EXPECT_LT(got.battery, 0) << "it is in a message of its own";
  EXPECT_EQ(got.tof_m, wanted.tof_m);
  EXPECT_EQ(got.height_m, wanted.height_m);
  EXPECT_EQ(got.sdk_state_fresh, wanted.sdk_state_fresh);
  EXPECT_EQ(got.applied_sequence, wanted.applied_sequence);
  EXPECT_EQ(got.playout_margin_ns, wanted.playout_margin_ns);
  EXPECT_EQ(got.arrived_sequence, wanted.arrived_sequence);
  EXPECT_EQ(got.arrived_ns, wanted.arrived_ns);
  EXPECT_EQ(got.sent_velocity_mps, wanted.sent_velocity_mps);
  EXPECT_EQ(got.sent_yaw_rate_radps, wanted.sent_yaw_rate_radps);
  EXPECT_EQ(got.attitude_rad, wanted.attitude_rad);
  EXPECT_EQ(got.acceleration_mps2, wanted.acceleration_mps2);
}

TEST(Ros, AStateWithoutOdometryHasNoPose) {
  const DroneState state = state_from_cdr(link_status_to_cdr(sample_status(), real_offset_ns), "").value();
  EXPECT_EQ(state.sample.sequence, 42U);
  EXPECT_EQ(state.sample.pose_stamp_ns, 0);
}

TEST(Ros, ALinkStatusOfBlocksWrittenBeforeIsRead) {
  CdrWriter out;
  for (const int value : {3, 1, 1}) out.put(static_cast<std::uint8_t>(value));
  for (const std::uint64_t value : {7, 42}) out.put(value);
  for (const TimeNs value : {1'000, 990}) out.put(value);
  for (const double value : {1, 2, 3, 4, 5, 6, -1}) out.put(value);
  for (const float value : {0.25F, 1.25F, 1.5F}) out.put(value);
  out.put(std::uint8_t{1});
  for (const TimeNs value : {41, 900, -3, 43, 995}) out.put(value);
  for (const float value : {0.5F, -0.5F, 0.25F, 0.125F}) out.put(value);
  for (const std::uint32_t value : {1, 2, 3}) out.put(value);
  for (const float value : {0.25F, -0.5F, 1.5F, 0.5F, -0.25F, 9.75F, 1.0F, 2.0F, 3.0F, 4.0F}) out.put(value);
  const StateSample got = state_from_cdr(out.release(), to_cdr(sample_odometry())).value().sample;
  EXPECT_EQ(got.phase, LinkPhase::flying);
  EXPECT_EQ(got.boot_id, 7U);
  EXPECT_EQ(got.stamp_ns, 1'000);
  EXPECT_EQ(got.pose_stamp_ns, 990);
  EXPECT_EQ(got.position_m, (std::array<double, 3>{1, 2, 3})) << "its own, not the odometry's";
  EXPECT_EQ(got.battery, 0.25F);
  EXPECT_EQ(got.arrived_sequence, 43U);
  EXPECT_EQ(got.arrived_ns, 995);
  EXPECT_EQ(got.pose_variance, (PoseVariance{1, 2, 3, 4}));
}

/// The .msg file, as rosidl reads it: each field's type and name, and the constants.
struct Definition {
  std::vector<std::pair<std::string, std::string>> fields;
  std::map<std::string, int> constants;
};

Definition definition_of(const std::string& path) {
  Definition definition;
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::string type, name;
    if (!(words >> type >> name)) continue;
    const auto equals = name.find('=');
    if (equals == std::string::npos)
      definition.fields.emplace_back(type, name);
    else
      definition.constants[name.substr(0, equals)] = std::stoi(name.substr(equals + 1));
  }
  return definition;
}

template <typename Enum>
void expect_constants(const Definition& definition, const std::string& prefix) {
  for (std::uint8_t i = 0; i < enum_count<Enum>; ++i) {
    std::string constant = prefix + std::string(name(static_cast<Enum>(i)));
    std::transform(constant.begin(), constant.end(), constant.begin(), ::toupper);
    ASSERT_TRUE(definition.constants.contains(constant)) << constant;
    EXPECT_EQ(definition.constants.at(constant), i) << constant;
  }
}

TEST(Ros, LinkStatusHasTheFieldsOfItsDefinition) {
  const Definition definition = definition_of(LEDGERLINE_SOURCE "/common/msg/ledgerline_msgs/msg/LinkStatus.msg");
  expect_constants<LinkPhase>(definition, "PHASE_");
  expect_constants<FailsafeMode>(definition, "MODE_");
  expect_constants<FailsafeCause>(definition, "CAUSE_");
  const StateSample s = sample_status();
  CdrWriter out;
  const std::map<std::string, std::function<void()>> values{
      {"stamp",
       [&] {
         out.put(static_cast<std::int32_t>((s.stamp_ns + real_offset_ns) / ns_per_s));
         out.put(static_cast<std::uint32_t>((s.stamp_ns + real_offset_ns) % ns_per_s));
       }},
      {"stamp_ns", [&] { out.put(s.stamp_ns); }},
      {"boot_id", [&] { out.put(s.boot_id); }},
      {"sequence", [&] { out.put(s.sequence); }},
      {"applied_sequence", [&] { out.put(s.applied_sequence); }},
      {"arrived_sequence", [&] { out.put(s.arrived_sequence); }},
      {"arrived_ns", [&] { out.put(s.arrived_ns); }},
      {"playout_margin_ns", [&] { out.put(s.playout_margin_ns); }},
      {"sent_velocity", [&] { out.put(s.sent_velocity_mps); }},
      {"sent_yaw_rate", [&] { out.put(s.sent_yaw_rate_radps); }},
      {"attitude", [&] { out.put(s.attitude_rad); }},
      {"acceleration", [&] { out.put(s.acceleration_mps2); }},
      {"tof", [&] { out.put(s.tof_m); }},
      {"height", [&] { out.put(s.height_m); }},
      {"sdk_state_fresh", [&] { out.put(static_cast<std::uint8_t>(s.sdk_state_fresh)); }},
      {"phase", [&] { out.put(static_cast<std::uint8_t>(s.phase)); }},
      {"mode", [&] { out.put(static_cast<std::uint8_t>(s.mode)); }},
      {"cause", [&] { out.put(static_cast<std::uint8_t>(s.cause)); }}};
  ASSERT_EQ(definition.fields.size(), values.size());
  for (const auto& [type, field] : definition.fields) {
    ASSERT_TRUE(values.contains(field)) << field;
    values.at(field)();
  }
  EXPECT_EQ(hex(link_status_to_cdr(s, real_offset_ns)), hex(out.release()));
}

/// A state's own part of what the ledger stores: see also the frame's, of agent.
TEST(Ros, BytesOfAStateAreKnown) {
  const StateSample s = sample_status();
  EXPECT_EQ(to_cdr(odometry_of(s, "tello1", real_offset_ns)).size(), 724U)
      << "of them 576 of covariances, most of them 0";
  EXPECT_EQ(link_status_to_cdr(s, real_offset_ns).size(), 120U) << "224 before";
}

std::vector<Transition> sample_transitions() {
  Transition hold{.phase = LinkPhase::flying,
                  .mode = FailsafeMode::hold,
                  .cause = FailsafeCause::agent_silent,
                  .boot_id = UINT64_MAX - 1,
                  .number = 41,
                  .lost = 2,
                  .stamp_ns = 77 * ns_per_s};
  Transition landed = hold;
  landed.phase = LinkPhase::landed;
  landed.mode = FailsafeMode::none;
  landed.cause = FailsafeCause::none;
  landed.number = 42;
  return {hold, landed};
}

TEST(Ros, TransitionsComeBackWholeAndInOrder) {
  const auto got = transitions_from_cdr(transitions_to_cdr({5, "tello1/base_link"}, "tello1", sample_transitions()));
  ASSERT_TRUE(got);
  ASSERT_EQ(got->size(), 2U);
  EXPECT_EQ((*got)[0].phase, LinkPhase::flying);
  EXPECT_EQ((*got)[0].mode, FailsafeMode::hold);
  EXPECT_EQ((*got)[0].cause, FailsafeCause::agent_silent);
  EXPECT_EQ((*got)[0].boot_id, UINT64_MAX - 1);
  EXPECT_EQ((*got)[0].number, 41U);
  EXPECT_EQ((*got)[0].lost, 2U);
  EXPECT_EQ((*got)[0].stamp_ns, 77 * ns_per_s);
  EXPECT_EQ((*got)[1].phase, LinkPhase::landed);
  EXPECT_EQ((*got)[1].number, 42U);
}

TEST(Ros, TransitionsWithValuesThatCannotBeAreRefused) {
  std::string text = transitions_to_cdr({5, "tello1/base_link"}, "tello1", sample_transitions());
  for (std::size_t cut = 0; cut < text.size(); ++cut) ASSERT_FALSE(transitions_from_cdr(text.substr(0, cut))) << cut;
  const auto at = text.rfind("landed");
  ASSERT_NE(at, std::string::npos);
  text.replace(at, 6, "Landed");
  EXPECT_FALSE(transitions_from_cdr(text));
}

TEST(Ros, AlarmsComeBackWholeAndDamagedOnesAreRefused) {
  std::string text =
      alarms_to_cdr({5, ""}, "tello1",
                    {{"records_differ", true, 3, "held by A; there by B", 41}, {"chain_broken", false, 1, "x", 7}});
  const auto got = alarms_from_cdr(text);
  ASSERT_TRUE(got);
  ASSERT_EQ(got->size(), 2U);
  EXPECT_EQ((*got)[0].kind, "records_differ");
  EXPECT_TRUE((*got)[0].stands);
  EXPECT_EQ((*got)[0].count, 3U);
  EXPECT_EQ((*got)[0].words, "held by A; there by B");
  EXPECT_EQ((*got)[0].block, 41U);
  EXPECT_EQ((*got)[1].kind, "chain_broken");
  EXPECT_FALSE((*got)[1].stands);
  EXPECT_TRUE(transitions_from_cdr(text)) << "of the same type";
  for (std::size_t cut = 0; cut < text.size(); ++cut) ASSERT_FALSE(alarms_from_cdr(text.substr(0, cut))) << cut;
  text.replace(text.find("41"), 2, "4x");
  EXPECT_FALSE(alarms_from_cdr(text));
}

TEST(Ros, EveryModeCauseAndPhaseHasANameOfItsOwn) {
  for (std::uint8_t i = 0; i < enum_count<FailsafeCause>; ++i) {
    EXPECT_EQ(from_name<FailsafeCause>(name(static_cast<FailsafeCause>(i))), static_cast<FailsafeCause>(i));
  }
  for (std::uint8_t i = 0; i <= static_cast<std::uint8_t>(FailsafeMode::cut); ++i) {
    EXPECT_EQ(from_name<FailsafeMode>(name(static_cast<FailsafeMode>(i))), static_cast<FailsafeMode>(i));
  }
  for (std::uint8_t i = 0; i <= static_cast<std::uint8_t>(LinkPhase::landed); ++i) {
    EXPECT_EQ(from_name<LinkPhase>(name(static_cast<LinkPhase>(i))), static_cast<LinkPhase>(i));
  }
  EXPECT_FALSE(from_name<FailsafeMode>("unknown"));
}

TEST(Ros, ValuesOfNoEnumerationAreRefused) {
  for (const std::size_t from_end : {1U, 2U, 3U}) {
    std::string text = link_status_to_cdr(sample_status(), 0);
    text[text.size() - from_end] = 100;
    EXPECT_FALSE(state_from_cdr(text, ""));
  }
}

TEST(Ros, TimesAndNumbersThatNoDroneCanSayAreRefused) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](const auto& spoil) {
    StateSample s = sample_status();
    spoil(s);
    return !there_and_back(s);
  };
  EXPECT_TRUE(refused([](auto& s) { s.stamp_ns = -1; }));
  EXPECT_TRUE(refused([](auto& s) { s.stamp_ns = INT64_MAX / 2; }));
  EXPECT_TRUE(refused([](auto& s) { s.pose_stamp_ns = -1; }));
  EXPECT_TRUE(refused([](auto& s) { s.playout_margin_ns = -1; }));
  EXPECT_TRUE(refused([](auto& s) { s.playout_margin_ns = INT64_MAX; }));
  EXPECT_TRUE(refused([](auto& s) { s.arrived_ns = -1; }));
  EXPECT_TRUE(refused([](auto& s) { s.position_m[2] = nan; }));
  EXPECT_TRUE(refused([](auto& s) { s.velocity_mps[0] = -1e300; }));
  EXPECT_TRUE(refused([](auto& s) { s.yaw_rad = std::numeric_limits<double>::infinity(); }));
  EXPECT_TRUE(refused([](auto& s) { s.pose_variance[1] = -1; }));
  EXPECT_TRUE(refused([](auto& s) { s.attitude_rad[1] = static_cast<float>(nan); }));
  EXPECT_TRUE(refused([](auto& s) { s.acceleration_mps2[2] = 1e30F; }));
  EXPECT_FALSE(refused([](auto& s) { s.playout_margin_ns = 3 * ns_per_s; }));
  EXPECT_FALSE(state_from_cdr(link_status_to_cdr(sample_status(), -500 * ns_per_s), "")) << "real time before 1970";
}

TEST(Ros, TruncatedMessagesAreErrorsThatNameTheType) {
  const std::string odometry = to_cdr(sample_odometry()), status = link_status_to_cdr(sample_status(), 0);
  const std::string battery = to_cdr(BatteryState{{0, "x"}, 1, 1});
  for (std::size_t cut = 0; cut < odometry.size(); ++cut)
    ASSERT_FALSE(odometry_from_cdr(odometry.substr(0, cut))) << cut;
  for (std::size_t cut = 0; cut < status.size(); ++cut)
    ASSERT_FALSE(state_from_cdr(status.substr(0, cut), odometry)) << cut;
  for (std::size_t cut = 0; cut < 40; ++cut) ASSERT_FALSE(battery_from_cdr(battery.substr(0, cut))) << cut;
  EXPECT_NE(odometry_from_cdr("").error().message.find("nav_msgs/msg/Odometry"), std::string::npos);
}

TEST(Ros, HostileBytesNeverCrash) {
  Random random(3);
  const std::string whole = to_cdr(sample_odometry()), status = link_status_to_cdr(sample_status(), 0);
  for (int i = 0; i < 5000; ++i) {
    std::string bad = whole;
    for (int k = 0; k < 4; ++k) bad[random.next() % 60] = static_cast<char>(random.next());
    (void)odometry_from_cdr(bad);
    (void)battery_from_cdr(bad);
    (void)state_from_cdr(bad, "");
    (void)state_from_cdr(status, bad);
    (void)transitions_from_cdr(bad);
    (void)alarms_from_cdr(bad);
    (void)twist_from_cdr(bad);
    (void)pose_from_cdr(bad);
  }
}

TEST(Ros, AnAttitudeTurnsYawFirstThenPitchThenRoll) {
  constexpr double right = std::numbers::pi / 2;
  const auto near = [](const std::array<double, 4>& a, const std::array<double, 4>& b) {
    for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(a[i], b[i], 1e-12) << i;
  };
  const double h = std::sqrt(0.5);
  near(quaternion_from_attitude(right, 0, 0), {h, 0, 0, h});
  near(quaternion_from_attitude(0, right, 0), {0, h, 0, h});
  near(quaternion_from_attitude(0, 0, right), {0, 0, h, h});
  // Nose to the left, then nose down: what was ahead is down, what was left is behind.
  near(quaternion_from_attitude(0, right, right), {-0.5, 0.5, 0.5, 0.5});
  near(quaternion_from_attitude(right, 0, right), {0.5, 0.5, 0.5, 0.5});
}

TEST(Ros, YawGoesThroughAQuaternion) {
  for (double yaw = -3.1; yaw < 3.1; yaw += 0.1) EXPECT_NEAR(yaw_from_quaternion(quaternion_from_yaw(yaw)), yaw, 1e-12);
  EXPECT_NEAR(quaternion_from_yaw(std::numbers::pi / 2)[2], std::sqrt(0.5), 1e-12);
}

}  // namespace
}  // namespace ledgerline
