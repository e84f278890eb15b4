#include "onboard/agent/shell/settings.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/msg/contract.hpp"
#include "common/msg/names.hpp"

namespace ledgerline::agent {
namespace {

/// Each reads what the config says in place of a default.
void read_ms(Config& config, TimeNs& value_ns, double min_ms, double max_ms, const Key& key) {
  value_ns = from_seconds(config.number(key, to_ms(value_ns), min_ms, max_ms) * 1e-3);
}
void read_s(Config& config, TimeNs& value_ns, double min_s, double max_s, const Key& key) {
  value_ns = from_seconds(config.number(key, to_seconds(value_ns), min_s, max_s));
}
void read(Config& config, double& value, double min, double max, const Key& key) {
  value = config.number(key, value, min, max);
}
template <typename Integer>
void read(Config& config, Integer& value, std::int64_t min, std::int64_t max, const Key& key) {
  value = static_cast<Integer>(config.integer(key, static_cast<std::int64_t>(value), min, max));
}

void read_batch(Config& config, BatchSettings& b) {
  read_ms(config, b.min_gap_ns, 0, 10'000,
          {"batch.min_gap_ms", "between the starts of two batches; 0: the next goes when the last is committed"});
  read_ms(config, b.linger_ns, 0, 1'000,
          {"batch.linger_ms",
           "a batch waits so long for this host's other samples of the same instant; 0 makes a transaction of each"});
  read_ms(config, b.freshness_ns, 1, 10'000,
          {"batch.freshness_ms", "a sample that waited until it is older is dropped"});
  read_ms(config, b.back_off.first_ns, 1, 10'000,
          {"batch.first_back_off_ms", "pause after the first failure; doubles with each further one, with jitter"});
  read_ms(config, b.back_off.max_ns, 1, 60'000, {"batch.max_back_off_ms", "its upper bound"});
  read_ms(config, b.refused_drone_pause_ns, 0, 60'000,
          {"batch.refused_drone_pause_ms", "a drone for whose sake a batch was refused stays out so long"});
  b.back_off.max_ns = std::max(b.back_off.max_ns, b.back_off.first_ns);
}

void read_check(Config& config, CommandCheckSettings& c) {
  read_ms(
      config, c.max_age_ns, 1, 60'000,
      {"check.max_age_ms", "a command for an older state is refused; `fly` sets it longer where blocks are cut late"});
  read(config, c.max_speed_mps, 0.01, 100,
       {"check.max_speed_mps", "a faster setpoint is refused; a Tello's top speed. Link bounds further"});
  read(config, c.max_yaw_rate_radps, 0.01, 100,
       {"check.max_yaw_rate_radps", "a setpoint that turns faster is refused"});
  read_ms(config, c.horizon_ns, 10, 60'000,
          {"check.horizon_ms", "a setpoint for later than now plus this is refused, as by the contract"});
  read(config, c.stamps_kept, 1, 100'000,
       {"check.stamps_kept", "newest states of each drone that a command may answer: 256 are 8 s at 30 a second"});
}

void read_fusion(Config& config, FusionSettings& f) {
  read(config, f.position_sigma_m, 1e-6, 10, {"mocap.position_sigma_m", "standard deviation of a measured position"});
  read(config, f.acceleration_sigma_mps2, 1e-3, 1'000,
       {"mocap.acceleration_sigma_mps2", "how much the velocity may change by itself; higher follows faster, noisier"});
  read(config, f.gate_sigma, 1, 1'000,
       {"mocap.gate_sigma", "a measurement further off, in standard deviations, is dropped as an outlier"});
  read(config, f.outliers_before_reset, 1, 1'000,
       {"mocap.outliers_before_reset", "so many outliers in a row reset the filter"});
  read_ms(config, f.max_gap_ns, 1, 60'000,
          {"mocap.max_gap_ms", "a longer pause resets the filter; as link's failsafe.pose_lost_ms"});
  read_ms(config, f.frozen_after_ns, 1, 60'000,
          {"mocap.frozen_after_ms", "in flight, the same position to the last bit for so long: mocap repeats itself"});
}

void read_idle_evict(Config& config, TimeNs& idle_evict_ns) {
  constexpr double min_s = 30;
  const Key key{"agent.idle_evict_s",
                "a drone seen on the ground for so long, without a command of its lease's holder, is taken from the "
                "holder; 0: never, else at least 30; longer than a change of batteries"};
  read_s(config, idle_evict_ns, 0, 86'400, key);
  if (idle_evict_ns == 0 || to_seconds(idle_evict_ns) >= min_s) return;
  config.wrong(key.name, fmt::format("must be 0 (never), or {:g} to 86400: a holder who has just acquired the drone "
                                     "needs a moment before its first command",
                                     min_s));
}

}  // namespace

Settings read_settings(Config& config, const std::string& msp_id, const fabric::ChannelAndContract& where) {
  Settings s;
  for (std::size_t i = 0; i < config.table_count({"drone", "one for each drone of this host"}); ++i) {
    const std::string key = fmt::format("drone.{}.", i);
    const auto number = config.integer({key + "number", "in shared memory; the same in link.toml", "place in the file"},
                                       static_cast<std::int64_t>(i) + 1, 1, max_drones);
    s.core.drones.push_back(
        {static_cast<DroneNumber>(number), config.text({key + "name", "as enrolled to this host's identity"})});
    const std::string& name = s.core.drones.back().name;
    if (!name.empty() && !contract::is_drone_name(name)) config.wrong(key + "name", contract::drone_name_rule);
  }
  read_batch(config, s.core.batch);
  read_check(config, s.core.check);
  s.core.check.msp_id = msp_id;
  s.core.check.where = where;
  read_fusion(config, s.core.fusion);
  read_ms(config, s.core.heartbeat_period_ns, 1, 100, {"agent.heartbeat_ms", "between heartbeats to link"});
  read_ms(config, s.core.ledger_silent_after_ns, 10, 60'000,
          {"agent.ledger_silent_after_ms",
           "without an answer or a connection for so long, link learns that the ledger is silent"});
  read_idle_evict(config, s.core.idle_evict_ns);
  read_s(config, s.recheck_ns, 0, 3'600,
         {"agent.recheck_s",
          "between comparisons of control records and roles with another organisation's peer, the first [[endorser]] "
          "of one; a lasting difference is an alarm (records_differ); 0: never"});
  read_s(config, s.core.integrity_hold_ns, 1, 3'600,
         {"agent.integrity_hold_s",
          "how long an integrity violation (of flags, orderers, other peers) keeps the alarm, and link informed "
          "(failsafe.on_untrusted_ledger)"});
  s.core.seed = 0;
  read(config, s.core.seed, 0, INT64_MAX, {"agent.seed", "of the back-off's jitter", "time of the start"});
  read_s(config, s.start_wait_ns, 0.1, 3'600,
         {"agent.start_wait_s", "for RouDi and for the ledger, each, at the start; then it ends"});
  read(config, s.priority, 0, 98,
       {"realtime.priority", "SCHED_FIFO from block to plan, below link's 80; 0: ordinary scheduling"});
  s.checkpoint = config.text({"output.checkpoint",
                              "file, of this agent alone, of the newest verified block and the control records: the "
                              "next start refuses a peer with an older chain or another one"},
                             "");
  read(config, s.max_absence_blocks, 0, 1'000'000,
       {"agent.max_absence_blocks",
        "blocks since the checkpoint that a start reads one by one; after a longer absence the newest counts by its "
        "orderers' signatures, and the control records are read again"});
  s.trace = config.text({"output.trace", "file for `ledgerline timing` and the report (binary)"}, "");
  s.summary = config.text({"output.summary", "JSON file of all counts, written at the end"}, "");
  std::int64_t status_ms = 0;
  read(config, status_ms, 0, 60'000,
       {"output.status_period_ms", "between JSON status lines on standard output; 0: none"});
  s.status_period_ns = status_ms * ns_per_ms;
  s.mocap_topic =
      config.text({"mocap.topic", "of its poses; {drone} is the drone's name; \"\": no mocap"}, usual_pose_topic);
  constexpr PoseMessage usual = PoseMessage::pose_stamped;
  s.mocap_message = from_name<PoseMessage>(
                        config.choice({"mocap.type", "of the topic's messages; of an array the drone's name counts"},
                                      {name(PoseMessage::pose_stamped), name(PoseMessage::odometry),
                                       name(PoseMessage::named_pose_array)},
                                      name(usual)))
                        .value_or(usual);
  s.mocap_stamps_are_of_this_host =
      config.choice({"mocap.clock", "whether its stamps are of this host's clock, or the arrival counts"},
                    {"host", "arrival"}, "host") == "host";
  return s;
}

std::vector<Settings> settings_of_channels(const Settings& process, const fabric::Channels& channels) {
  std::vector<Settings> all;
  for (std::size_t i = 0; i < channels.all.size(); ++i) {
    Settings one = process;
    one.core.drones.clear();
    for (std::size_t drone = 0; drone < process.core.drones.size(); ++drone) {
      if (channels.of_drone[drone] == i) one.core.drones.push_back(process.core.drones[drone]);
    }
    one.core.check.where = {channels.all[i].name, channels.all[i].contract};
    one.core.seed += i;  // so that their back-offs do not go in step
    one.checkpoint = fabric::file_of_channel(process.checkpoint, channels, i);
    all.push_back(std::move(one));
  }
  return all;
}

bridge::BridgeConfig read_bridge(Config& config, const std::vector<DroneName>& drones) {
  bridge::Host host{.topics = {}, .enrolled = {}, .sends_states = true};
  for (const DroneName& drone : drones) {
    host.enrolled.push_back(drone.name);
    for (const char* own : {"odom", "link", "battery", "failsafe", "alarm"})
      host.topics.push_back(fmt::format("/{}/{}", drone.name, own));
  }
  return bridge::read_bridge(config, &host);
}

}  // namespace ledgerline::agent
