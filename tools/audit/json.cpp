#include <nlohmann/json.hpp>

#include "common/msg/names.hpp"
#include "common/page/html.hpp"
#include "common/rt/histogram.hpp"
#include "tools/audit/chain_audit.hpp"

namespace ledgerline::report {
extern const char audit_template[];  // page.html, put into the program by CMake
}

namespace ledgerline::audit {
namespace {

using nlohmann::json;

json seconds(TimeNs time_ns) { return time_ns > 0 ? json(rounded(to_seconds(time_ns))) : json(); }

json to_json(const Moment& moment) {
  return {{"block", moment.block}, {"time_s", seconds(moment.time_ns)}, {"tx_id", moment.tx_id}};
}

json to_json(const std::map<int, std::uint64_t>& codes) {
  json out = json::object();
  for (const auto& [code, count] : codes) out[code_name(code)] = count;
  return out;
}

json to_json(const FirstOnes<Event>& events) {
  json out = json::array();
  for (const Event& event : events.all())
    out.push_back({{"what", event.what}, {"object", event.object}, {"who", event.who}, {"when", to_json(event.when)}});
  return out;
}

json holders_of(const DroneReport& drone) {
  json out = json::array();
  for (const Tenure& t : drone.holders.all()) {
    out.push_back({{"who", t.who},
                   {"delegate", t.delegate},
                   {"epoch", t.epoch},
                   {"priority", t.priority},
                   {"from", to_json(t.from)},
                   {"to", t.to ? to_json(*t.to) : json()},
                   {"ended_by", t.ended_by}});
  }
  return out;
}

json commands_of(const DroneReport& drone) {
  json out = json::array();
  for (const auto& [who, c] : drone.commands) {
    out.push_back({{"who", who},
                   {"valid", c.valid},
                   {"invalid", to_json(c.invalid)},
                   {"first", to_json(c.first)},
                   {"last", to_json(c.last)}});
  }
  return out;
}

json over_time(const OverTime& counted) {
  json counts = json::array();
  const double width_s = to_seconds(counted.width_ns());
  for (const auto& [at, both] : counted.counts())
    counts.push_back({static_cast<double>(at) * width_s, both.first, both.second});
  return {{"width_s", width_s}, {"counts", counts}};
}

json transitions_of(const DroneReport& drone) {
  json out = json::array();
  for (const Change& change : drone.transitions.all()) {
    const Transition& t = change.transition;
    out.push_back({{"number", t.number},
                   {"phase", name(t.phase)},
                   {"mode", name(t.mode)},
                   {"cause", name(t.cause)},
                   {"stamp_ns", t.stamp_ns},
                   {"boot_id", std::to_string(t.boot_id)},  // beyond what JSON's numbers hold
                   {"when", to_json(change.when)}});
  }
  return out;
}

json to_json(const DroneReport& drone) {
  json path = json::array();
  for (const PathPoint& p : drone.path.all())
    path.push_back({rounded(p.position_m[0]), rounded(p.position_m[1]), rounded(p.position_m[2]), seconds(p.stamp_ns)});
  return {{"holders", holders_of(drone)},
          {"commands", commands_of(drone)},
          {"commands_over_time", over_time(drone.commands_over_time)},
          {"words", to_json(drone.events)},
          {"failsafe", transitions_of(drone)},
          {"failsafe_missing", drone.transitions_missing},
          {"states", drone.states},
          {"two_way_ms", drone.two_way.quantiles_ms()},
          {"path", path},
          {"poses", drone.path.count()},
          {"left_out",
           {{"holders", drone.holders.left_out()},
            {"words", drone.events.left_out()},
            {"failsafe", drone.transitions.left_out()}}}};
}

}  // namespace

json to_json(const ChainAudit& audit, const AuditRequest& asked) {
  const Counts& c = audit.counts();
  const ChainReport& report = audit.report();
  json findings = json::array(), refusals = json::array(), drones = json::object();
  for (const Finding& f : audit.findings()) {
    findings.push_back({{"block", f.block},
                        {"transaction", f.transaction ? json(*f.transaction) : json()},
                        {"tx_id", f.tx_id},
                        {"what", f.what}});
  }
  for (const auto& [key, r] : report.refusals()) {
    refusals.push_back({{"code", code_name(key.code)},
                        {"who", key.who},
                        {"function", key.function},
                        {"count", r.count},
                        {"why", r.why},
                        {"first", to_json(r.first)}});
  }
  json anchors = to_json(report.anchors());
  for (std::size_t i = 0; i < anchors.size(); ++i)
    anchors[i]["before"] = report.anchors().all()[i].when.time_ns < asked.span.from_ns;
  for (const auto& [name, drone] : report.drones()) {
    if (asked.reports(name)) drones[name] = to_json(drone);
  }
  return {{"ok", c.findings == 0},
          {"asked",
           {{"channel", asked.channel},
            {"source", asked.source},
            {"anchor", asked.anchor},
            {"drones", asked.drones},
            {"counted", asked.counted()},
            {"from_s", asked.span.is_from_the_start() ? json() : json(to_seconds(asked.span.from_ns))},
            {"to_s", asked.span.is_to_the_end() ? json() : json(to_seconds(asked.span.to_ns))}}},
          {"first_difference", audit.findings().empty() ? json() : json(to_text(audit.findings().front()))},
          {"verdict", verdict(audit)},
          {"findings", findings},
          {"findings_count", c.findings},
          {"blocks", c.blocks},
          {"config_blocks", c.config_blocks},
          {"blocks_without_flags", c.without_flags},
          {"newest_block", audit.height() > 0 ? json(audit.height() - 1) : json()},
          {"newest_hash", audit.newest_hash()},
          {"transactions", c.transactions},
          {"valid", c.valid},
          {"invalid", to_json(c.invalid)},
          {"endorsements", c.endorsements},
          {"from_s", seconds(report.first_ns())},
          {"to_s", seconds(report.last_ns())},
          {"functions", report.functions()},
          {"roles", to_json(report.roles())},
          {"anchors", anchors},
          {"refusals", refusals},
          {"refusals_left_out", report.refusals_left_out()},
          {"drones", drones}};
}

std::string to_page(json document) {
  document["date"] = page::local_date();
  return page::filled(report::audit_template, "@DATA@", page::for_script(document));
}

}  // namespace ledgerline::audit
