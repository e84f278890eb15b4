#include "onboard/link/shell/report.hpp"

#include <nlohmann/json.hpp>

#include "common/base/file.hpp"
#include "common/msg/names.hpp"

namespace ledgerline::link {
namespace {

nlohmann::json to_json(const DroneReport& report, std::uint64_t states_lost) {
  nlohmann::json reasons = nlohmann::json::object();
  for (std::size_t i = 1; i < report.plans.dropped_by.size(); ++i) {
    if (report.plans.dropped_by[i] > 0)
      reasons[std::string(name(static_cast<DropReason>(i)))] = report.plans.dropped_by[i];
  }
  return {{"name", report.name},
          {"states_sampled", report.states_sampled},
          {"states_lost", states_lost},
          {"commands_received", report.plans.received},
          {"commands_applied", report.plans.applied},
          {"commands_late", report.plans.late},
          {"commands_dropped", report.plans.dropped},
          {"drop_reasons", reasons},
          {"transitions",
           {{"made", report.transitions.made},
            {"on_ledger", report.transitions.on_ledger},
            {"lost", report.transitions.lost},
            {"kept", report.transitions.kept}}},
          {"age_ms", report.age_ms},
          {"landed", report.landed},
          {"phase", name(report.phase)}};
}

nlohmann::json to_json(const LoopMetrics& loop) {
  const auto late_us = [&](double quantile) { return loop.lateness.quantile(quantile) / ns_per_us; };
  return {{"cycles", loop.cycles},
          {"overruns", loop.overruns},
          {"lateness_us",
           {{"p50", late_us(0.5)},
            {"p95", late_us(0.95)},
            {"p99", late_us(0.99)},
            {"p99_9", late_us(0.999)},
            {"max", loop.lateness.max() / ns_per_us}}},
          {"sends_failed", loop.sends_failed},
          {"trace_lost", loop.trace_lost}};
}

}  // namespace

std::string status_line(const LinkSettings& settings, const std::array<StateSample, max_drones + 1>& newest,
                        const std::array<std::optional<SerialReport>, max_drones + 1>& serials) {
  nlohmann::json drones = nlohmann::json::array();
  for (const DroneSettings& drone : settings.drones) {
    const StateSample& state = newest[drone.number];
    const nlohmann::json pose_age_ms =
        state.pose_stamp_ns > 0 ? nlohmann::json(to_ms(state.stamp_ns - state.pose_stamp_ns)) : nlohmann::json();
    const std::optional<SerialReport>& reported = serials[drone.number];
    const bool is_known = reported && reported->verdict != SerialCheck::Verdict::open;
    const nlohmann::json serial = is_known ? nlohmann::json(reported->answered.view()) : nlohmann::json();
    drones.push_back({{"name", drone.name},
                      {"phase", name(state.phase)},
                      {"serial", serial},
                      {"diverted", state.diverted},
                      {"mode", name(state.mode)},
                      {"cause", name(state.cause)},
                      {"battery", state.battery},
                      {"temperature_c", state.temperature_c},
                      {"position", state.position_m},
                      {"pose_age_ms", pose_age_ms},
                      {"applied", state.plans_applied},
                      {"dropped", state.plans_dropped},
                      {"late", state.plans_late}});
  }
  return nlohmann::json{{"link", {{"drones", drones}}}}.dump();
}

Status write_summary(const std::string& path, const LinkCore& core, const LoopMetrics& loop,
                     const PublisherThread& publisher, bool realtime) {
  nlohmann::json drones = nlohmann::json::array();
  for (const DroneReport& report : core.reports()) drones.push_back(to_json(report, publisher.lost(report.number)));
  const nlohmann::json summary{{"drones", drones}, {"loop", to_json(loop)}, {"realtime", realtime}};
  return write_file(path, summary.dump(2) + "\n");
}

}  // namespace ledgerline::link
