#include "onboard/agent/shell/settings.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace ledgerline::agent {
namespace {

TimeNs duration_ms(Config& config, const std::string& key, TimeNs otherwise_ns, double min_ms, double max_ms) {
  return from_seconds(config.number(key, to_ms(otherwise_ns), min_ms, max_ms) * 1e-3);
}

BatchConfig batch(Config& config) {
  BatchConfig b;
  b.min_gap_ns = duration_ms(config, "batch.min_gap_ms", b.min_gap_ns, 0, 10'000);
  b.linger_ns = duration_ms(config, "batch.linger_ms", b.linger_ns, 0, 1'000);
  b.freshness_ns = duration_ms(config, "batch.freshness_ms", b.freshness_ns, 1, 10'000);
  b.first_back_off_ns = duration_ms(config, "batch.first_back_off_ms", b.first_back_off_ns, 1, 10'000);
  b.max_back_off_ns = duration_ms(config, "batch.longest_back_off_ms", b.max_back_off_ns, 1, 60'000);
  b.refused_drone_pause_ns = duration_ms(config, "batch.refused_drone_pause_ms", b.refused_drone_pause_ns, 0, 60'000);
  b.max_back_off_ns = std::max(b.max_back_off_ns, b.first_back_off_ns);
  return b;
}

CheckConfig check(Config& config) {
  CheckConfig c;
  c.max_age_ns = duration_ms(config, "check.max_age_ms", c.max_age_ns, 1, 60'000);
  c.max_speed_mps = config.number("check.max_speed_mps", c.max_speed_mps, 0.01, 100);
  c.max_yaw_rate_radps = config.number("check.max_yaw_rate_radps", c.max_yaw_rate_radps, 0.01, 100);
  c.horizon_ns = duration_ms(config, "check.horizon_ms", c.horizon_ns, 10, 60'000);
  c.stamps_kept = static_cast<std::size_t>(
      config.integer("check.stamps_kept", static_cast<std::int64_t>(c.stamps_kept), 1, 100'000));
  return c;
}

FusionConfig fusion(Config& config) {
  FusionConfig f;
  f.position_sigma_m = config.number("mocap.position_sigma_m", f.position_sigma_m, 1e-6, 10);
  f.acceleration_sigma_mps2 = config.number("mocap.acceleration_sigma_mps2", f.acceleration_sigma_mps2, 1e-3, 1'000);
  f.gate_sigma = config.number("mocap.gate_sigma", f.gate_sigma, 1, 1'000);
  f.outliers_before_reset =
      static_cast<int>(config.integer("mocap.outliers_before_reset", f.outliers_before_reset, 1, 1'000));
  f.max_gap_ns = duration_ms(config, "mocap.longest_gap_ms", f.max_gap_ns, 1, 60'000);
  f.frozen_after_ns = duration_ms(config, "mocap.frozen_after_ms", f.frozen_after_ns, 1, 60'000);
  return f;
}

}  // namespace

Settings read_settings(Config& config, const std::string& msp_id, const fabric::ChannelAndContract& where) {
  Settings s;
  for (std::size_t i = 0; i < config.table_count("drone"); ++i) {
    const std::string key = fmt::format("drone.{}.", i);
    const auto number = config.integer(key + "number", static_cast<std::int64_t>(i) + 1, 1, max_drones);
    s.core.drones.push_back({static_cast<DroneNumber>(number), config.text(key + "name")});
  }
  s.core.batch = batch(config);
  s.core.check = check(config);
  s.core.check.msp_id = msp_id;
  s.core.check.where = where;
  s.core.fusion = fusion(config);
  s.core.beat_period_ns = duration_ms(config, "agent.beat_ms", s.core.beat_period_ns, 1, 100);
  s.core.ledger_silent_after_ns =
      duration_ms(config, "agent.ledger_silent_after_ms", s.core.ledger_silent_after_ns, 10, 60'000);
  s.core.seed = static_cast<std::uint64_t>(config.integer("agent.seed", 0, 0, INT64_MAX));
  s.start_wait_ns = from_seconds(config.number("agent.start_wait_s", 15, 0.1, 3'600));
  s.priority = static_cast<int>(config.integer("realtime.priority", 0, 0, 98));
  s.trace = config.text("output.trace", "");
  s.summary = config.text("output.summary", "");
  s.status_period_ns = config.integer("output.status_period_ms", 250, 0, 60'000) * ns_per_ms;
  s.mocap_topic = config.text("mocap.topic", "/vrpn_mocap/{drone}/pose");
  s.mocap_stamps_are_of_this_host = config.choice("mocap.clock", {"host", "arrival"}, "host") == "host";
  return s;
}

bridge::BridgeConfig read_bridge(Config& config, const std::vector<DroneName>& drones) {
  bridge::Host host{.topics = {}, .enrolled = {}, .has_frame = true};
  for (const DroneName& drone : drones) {
    host.enrolled.push_back(drone.name);
    for (const char* own : {"odom", "link", "battery", "failsafe"})
      host.topics.push_back(fmt::format("/{}/{}", drone.name, own));
  }
  return bridge::read_bridge(config, &host);
}

}  // namespace ledgerline::agent
