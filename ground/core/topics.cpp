#include "ground/core/flight_types.hpp"

#include "ground/core/manual.hpp"

namespace ledgerline::ground {
namespace {

const std::string nothing;

/// `message` as it is, if it can be read as what it says it is.
template <typename Read>
Result<std::string> as_it_is(const std::string& message, Read read) {
  if (message.empty()) return nothing;
  if (const auto whole = read(message); !whole) return whole.error();
  return message;
}

Result<std::string> odometry(const DroneUpdate& update, const std::string&) {
  return as_it_is(update.odometry, odometry_from_cdr);
}

template <typename Make>
Result<std::string> from_odometry(const DroneUpdate& update, Make make) {
  if (update.odometry.empty()) return nothing;
  const auto odometry = odometry_from_cdr(update.odometry);
  if (!odometry) return odometry.error();
  return make(*odometry);
}

Result<std::string> pose(const DroneUpdate& update, const std::string&) {
  return from_odometry(update, [](const Odometry& o) {
    return to_cdr(PoseStamped{o.header, o.position_m, o.orientation});
  });
}

Result<std::string> transform(const DroneUpdate& update, const std::string&) {
  return from_odometry(update, [](const Odometry& o) {
    return to_cdr(std::vector<TransformStamped>{{o.header, o.child_frame_id, o.position_m, o.orientation}});
  });
}

Result<std::string> battery(const DroneUpdate& update, const std::string&) {
  return as_it_is(update.battery, battery_from_cdr);
}

Result<std::string> imu(const DroneUpdate& update, const std::string& drone) {
  if (!update.state || !update.state->sdk_state_fresh) return nothing;
  const auto& [roll, pitch, yaw] = update.state->attitude_rad;
  const auto& a = update.state->acceleration_mps2;
  return to_cdr(
      Imu{{update.real_ns, drone + "/base_link"}, quaternion_from_attitude(roll, pitch, yaw), {a[0], a[1], a[2]}});
}

Result<std::string> diagnostics(const DroneUpdate& update, const std::string&) {
  return as_it_is(update.transitions, transitions_from_cdr);
}

Result<std::string> alarm(const DroneUpdate& update, const std::string&) {
  return as_it_is(update.alarm, alarms_from_cdr);
}

Result<std::string> diagnosis(const DroneUpdate& update, const std::string&) { return update.diagnosis; }

void velocity(std::string_view cdr, TimeNs came_ns, PilotCommand& command) {
  const auto twist = twist_from_cdr(cdr);
  if (!twist) {
    ++command.malformed;
    return;
  }
  if (!plausible(*twist)) {
    ++command.bad_values;
    return;
  }
  set_velocity(*twist, came_ns, command);
}

template <bool PilotCommand::*word>
void say(std::string_view, TimeNs, PilotCommand& command) {
  command.*word = true;
}

}  // namespace

const std::array<DroneTopic, 8> drone_topics{{
    {"/odom", false, odometry_type, false, odometry},
    {"/pose", false, pose_type, false, pose},
    {"/tf", true, transforms_type, false, transform},
    {"/battery", false, battery_type, false, battery},
    {"/imu", false, imu_type, false, imu},
    {"/diagnostics", true, transitions_type, true, diagnostics},
    // Writers of their own: who comes late gets the last ones of each.
    {"/diagnostics", true, transitions_type, true, diagnosis, true},
    {"/diagnostics", true, alarms_type, true, alarm},
}};

const std::array<PilotTopic, 5> pilot_topics{{
    {"/cmd_vel", twist_type, false, false, velocity},
    {"/takeoff", empty_type, true, false, say<&PilotCommand::takeoff>},
    {"/land", empty_type, true, false, say<&PilotCommand::land>},
    {"/stop", empty_type, true, false, say<&PilotCommand::stop>},
    {"/emergency", empty_type, true, true, say<&PilotCommand::cut>},
}};

std::string topic_of(const DroneTopic& topic, const std::string& drone) {
  return (topic.of_all ? "" : "/" + drone) + std::string(topic.name);
}

std::string topic_of(const PilotTopic& topic, const std::string& drone) {
  return "/" + drone + std::string(topic.name);
}

}  // namespace ledgerline::ground
