#include "ground/service/missions/book.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "ground/json/strict.hpp"
#include "ground/mission/check.hpp"

namespace ledgerline::ground::service {
namespace {

using ground::json::dump;
using mission::MissionRun;
using mission::RunPhase;
using nlohmann::json;

constexpr std::size_t id_digits = 12;
constexpr std::size_t max_reported_findings = 20;
// What MissionRun keeps, one deeper, and whose it is.
constexpr ground::json::Bounds kept_bounds{mission::max_saved_bytes + 4096, 8,
                                           (5 * motion::max_waypoints + 20) * mission::max_drones + 40};

Error unknown(const std::string& id) { return Error{fmt::format("there is no mission \"{}\"", id.substr(0, 64))}; }

/// What to do with one that is over.
std::string flown(const std::string& name, const std::string& id) {
  return fmt::format(
      "mission {} has been flown; its owner removes it (`ledgerline missions remove {}`), then it is added again", name,
      id);
}

/// {"tello1":[[x,y,z]...]}, in text: it is as long as the mission.
std::string paths_of(const mission::Mission& mission, double height_m) {
  std::string paths = "{";
  for (const mission::MissionDrone& drone : mission.drones) {
    paths += fmt::format(R"({}"{}":[)", paths.size() > 1 ? "," : "", drone.drone);
    bool first = true;
    for (const motion::Waypoint& waypoint : drone.way()) {
      paths += fmt::format("{}[{},{},{}]", first ? "" : ",", waypoint.at_m.x(), waypoint.at_m.y(),
                           waypoint.height_m.value_or(height_m));
      first = false;
    }
    paths += "]";
  }
  return paths + "}";
}

json texts_of(const std::vector<crypto::IdentityName>& all) {
  json texts = json::array();
  for (const auto& one : all) texts.push_back(service::text_of(one));
  return texts;
}

}  // namespace

MissionBook::MissionBook(MissionSettings settings, crypto::IdentityName self)
    : settings_(std::move(settings)), self_(std::move(self)) {
  if (settings_.approvers.empty()) settings_.approvers = {self_.msp_id};
}

Result<std::string> MissionBook::add(MissionRun run, std::optional<crypto::IdentityName> by) {
  const std::string id = crypto::hex(run.digest()).substr(0, id_digits);
  if (const Entry* known = find(id)) {
    return Error{known->run->phase() >= RunPhase::done
                     ? flown(run.mission().name, id)
                     : fmt::format("mission {} is here already, as {}", run.mission().name, id)};
  }
  if (missions_.size() >= max_missions)
    return Error{fmt::format("there are {} missions already: remove one", max_missions)};
  Entry entry{.run = std::make_unique<MissionRun>(std::move(run)), .paths = {}, .by = std::move(by)};
  entry.paths = paths_of(entry.run->mission(), settings_.check.flight.height_m);
  entry.phase = entry.run->phase();
  entry.stirred = entry.run->active() || entry.run->landing_due();  // a restored one has drones to find
  missions_.emplace(id, std::move(entry));
  changed_ = true;
  return id;
}

Result<std::string> MissionBook::restore(std::string_view text) {
  const auto kept = ground::json::object_from(text, "the kept mission", kept_bounds);
  if (!kept) return kept.error();
  if (const Status keys = ground::json::only(*kept, {"by", "run"}); !keys) return keys.error();
  std::optional<crypto::IdentityName> by;
  if (const json said = kept->value("by", json());
      said.is_array() && said.size() == 2 && said[0].is_string() && said[1].is_string())
    by = crypto::IdentityName{said[0].get<std::string>(), said[1].get<std::string>()};
  else if (!said.is_null())
    return Error{"the kept mission: by must be null, or an MSP id and a subject"};
  auto run = MissionRun::restore(dump(kept->value("run", json())), settings_.run);
  if (!run) return run.error();
  return add(std::move(*run), std::move(by));
}

Status MissionBook::may(const std::optional<crypto::IdentityName>& by, const Entry& entry) const {
  const bool is_nobodys = !entry.by && !entry.run->active();  // from before operators signed in, or disowned
  if (!by || by == entry.by || is_nobodys) return done;
  return Error{fmt::format("mission {} is {}'s, who alone may ask that of it; to have it land anybody may",
                           entry.run->mission().name, text_of(whose(entry.by)))};
}

void MissionBook::disown(const crypto::IdentityName& owner) {
  for (auto& [id, entry] : missions_) {
    if (entry.by != owner || entry.run->active() || entry.run->landing_due()) continue;
    entry.by.reset();
    changed_ = true;
  }
}

Status MissionBook::remove(const std::string& id, const std::optional<crypto::IdentityName>& by) {
  const Entry* entry = find(id);
  if (entry == nullptr) return unknown(id);
  if (const Status allowed = may(by, *entry); !allowed) return allowed;
  if (entry->run->active() || entry->run->landing_due())
    return Error{fmt::format("mission {} is flown, or its drones are landing", entry->run->mission().name)};
  missions_.erase(id);
  changed_ = true;
  return done;
}

MissionBook::Entry* MissionBook::find(const std::string& id) {
  const auto found = missions_.find(id);
  return found == missions_.end() ? nullptr : &found->second;
}

void MissionBook::set_signers(const std::string& id, const std::vector<crypto::IdentityName>& signers) {
  Entry* entry = find(id);
  if (entry == nullptr) return;
  entry->signers.clear();
  std::vector<mission::Approval> approvals;
  for (const crypto::IdentityName& signer : signers) {
    if (std::ranges::find(settings_.approvers, signer.msp_id) == settings_.approvers.end()) continue;
    entry->signers.push_back(signer);
    approvals.push_back({signer, entry->run->digest()});
  }
  entry->run->set_approvals(approvals);
  changed_ = true;
}

void MissionBook::set_findings(const std::string& id, std::vector<mission::Finding> findings) {
  Entry* entry = find(id);
  if (entry == nullptr) return;
  entry->findings = std::move(findings);
  changed_ = true;
}

Status MissionBook::may_fly(const Entry& entry, const mission::Mission& part,
                            const std::optional<crypto::IdentityName>& by, const Checked& checked,
                            const FlightView& flights) const {
  for (const mission::MissionDrone& one : part.drones) {
    const auto drone = index_of(flights.drones(), one.drone);
    if (!drone) continue;  // a finding
    const Lease& lease = flights.lease(*drone);
    if (lease.holder != whose(by) || lease.commander != flights.config().self) {
      return Error{fmt::format("{}: its lease is {}: take control of it first", one.drone,
                               lease.holder ? "held by " + holder_words(lease) : "nobody's")};
    }
    for (const auto& [id, other] : missions_) {
      const auto& drones = other.run->mission().drones;
      const bool has_it = std::ranges::any_of(drones, [&](const auto& d) { return d.drone == one.drone; });
      if (&other != &entry && other.run->active() && has_it)
        return Error{fmt::format("{} flies in mission {}", one.drone, other.run->mission().name)};
    }
  }
  const auto forbids =
      std::ranges::find_if(checked.findings, [](const mission::Finding& finding) { return finding.forbids; });
  if (forbids != checked.findings.end()) return Error{forbids->words};
  for (const mission::DroneNow& then : checked.then) {
    const mission::DroneNow now = mission::drone_now(flights, *index_of(flights.drones(), then.name));
    const bool moved = then.at_m.has_value() != now.at_m.has_value() ||
                       (now.at_m && (*now.at_m - *then.at_m).norm() > settings_.check.start_near_m);
    if (moved || then.phase != now.phase)
      return Error{fmt::format("{} has moved since it was checked: try again", then.name)};
  }
  return done;
}

template <typename Say>
Status MissionBook::apply_request(const std::string& id, const Say& say) {
  Entry* entry = find(id);
  if (entry == nullptr) return unknown(id);
  if (const Status said = say(*entry); !said) return said;
  changed_ = entry->stirred = true;
  return done;
}

Status MissionBook::start(const std::string& id, const std::optional<crypto::IdentityName>& by, const Checked& checked,
                          const FlightView& flights) {
  return apply_request(id, [&](Entry& entry) -> Status {
    if (const Status allowed = may(by, entry); !allowed) return allowed;
    if (!flights.config().manual) return Error{"this flight flies a path of its own"};
    if (entry.run->phase() >= RunPhase::done) return Error{flown(entry.run->mission().name, id)};
    set_findings(id, checked.findings);
    // What is missing is said first: one that is flown already is not where it was checked.
    if (entry.run->phase() < RunPhase::taking_off) {
      if (const Status may = may_fly(entry, entry.run->mission(), by, checked, flights); !may) return may;
    }
    if (const Status started = entry.run->start(checked.findings); !started) return started;
    entry.by = by;
    return done;
  });
}

Status MissionBook::pause(const std::string& id, const std::optional<crypto::IdentityName>& by) {
  return apply_request(id, [&](const Entry& entry) -> Status {
    const Status allowed = may(by, entry);
    return allowed ? entry.run->pause() : allowed;
  });
}

Status MissionBook::resume(const std::string& id, const std::optional<crypto::IdentityName>& by, const Checked& checked,
                           const FlightView& flights) {
  return apply_request(id, [&](Entry& entry) -> Status {
    if (const Status allowed = may(by, entry); !allowed) return allowed;
    if (const Status may = may_fly(entry, entry.run->rest(), by, checked, flights); !may) return may;
    return entry.run->resume();
  });
}

Status MissionBook::land(const std::string& id, const std::string& why) {
  return apply_request(id, [&](const Entry& entry) { return entry.run->end(why); });
}

void MissionBook::resume_after_check(const std::string& id, const Checked& checked, const FlightView& flights) {
  Entry* entry = find(id);
  if (entry == nullptr || !entry->run->awaits_check()) return;
  entry->run->resume_after_check(may_fly(*entry, entry->run->rest(), entry->by, checked, flights));
  changed_ = entry->stirred = true;
}

bool MissionBook::busy() const {
  return std::ranges::any_of(missions_, [](const auto& one) { return one.second.stirred || one.second.run->active(); });
}

// A drone that its starter holds no more, or that we do not command, is lost for its mission, whatever it does.
std::vector<mission::DroneNow> MissionBook::drones_for(const Entry& entry, std::vector<mission::DroneNow> drones,
                                                       const FlightView& flights) const {
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const Lease& lease = flights.lease(i);
    // Without a record nothing is known yet: after a restart it is waited for.
    if (!lease.record || (lease.holder == whose(entry.by) && lease.commander == flights.config().self)) continue;
    drones[i].phase = GroundPhase::failed;
    drones[i].on_ground = true;  // it is not ours to land
    drones[i].why = "its lease is " + (lease.holder ? "held by " + holder_words(lease) : "nobody's");
  }
  return drones;
}

MissionBook::Outputs MissionBook::step(TimeNs now, const FlightView& flights) {
  const std::vector<mission::DroneNow> drones = mission::drones_now(flights);
  Outputs out;
  for (auto& [id, entry] : missions_) {
    if (!entry.stirred && !entry.run->active()) continue;
    mission::RunOutputs made = entry.run->step(now, drones_for(entry, drones, flights));
    entry.stirred = entry.run->landing_due();
    for (PilotCommand& command : made.commands) {
      command.by = entry.by;
      out.commands.push_back(std::move(command));
    }
    out.events.insert(out.events.end(), made.events.begin(), made.events.end());
    if (made.changed) out.kept.push_back(id);
    changed_ = changed_ || made.changed;
    if (entry.run->awaits_check() && !std::exchange(entry.check_requested, true)) out.awaiting_check.push_back(id);
    const RunPhase phase = entry.run->phase();
    if (std::exchange(entry.phase, phase) != phase && phase >= RunPhase::done) out.ended.push_back(id);
  }
  return out;
}

std::vector<std::string> MissionBook::ids() const {
  std::vector<std::string> all;
  for (const auto& [id, entry] : missions_) all.push_back(id);
  return all;
}

json MissionBook::json_of(const std::string& id, const Entry& entry) const {
  const MissionRun& run = *entry.run;
  json drones = json::array(), reached = json::object(), findings = json::array();
  for (std::size_t i = 0; i < run.mission().drones.size(); ++i) {
    drones.push_back(run.mission().drones[i].drone);
    reached[run.mission().drones[i].drone] = run.reached(i);
  }
  for (const mission::Finding& finding : entry.findings) {
    if (findings.size() >= max_reported_findings) break;
    findings.push_back({{"drone", finding.drone},
                        {"waypoint", finding.waypoint ? json(*finding.waypoint) : json()},
                        {"words", finding.words},
                        {"forbids", finding.forbids}});
  }
  return {{"id", id},
          {"hash", crypto::hex(run.digest())},
          {"name", run.mission().name},
          {"drones", drones},
          {"phase", mission::name_of(run.phase())},
          {"paused", run.paused()},
          {"why", run.why()},
          {"by", entry.by ? text_of(*entry.by) : ""},
          {"approvals", texts_of(entry.signers)},
          {"approvals_needed", settings_.run.required_approvals},
          {"findings", findings},
          {"reached", reached}};
}

std::string MissionBook::list() const {
  json all = json::array();
  for (const auto& [id, entry] : missions_) all.push_back(json_of(id, entry));
  return dump(all);
}

std::string MissionBook::show(const std::string& id) const {
  const Entry& entry = missions_.at(id);
  std::string shown = dump(json_of(id, entry));
  shown.back() = ',';
  return shown + R"("paths":)" + entry.paths + "}";
}

std::string MissionBook::saved(const std::string& id) const {
  const Entry& entry = missions_.at(id);
  const json by = entry.by ? json::array({entry.by->msp_id, entry.by->subject}) : json();
  return fmt::format(R"({{"by":{},"run":{}}})", dump(by), entry.run->saved());
}

std::string MissionBook::record(const std::string& id, std::int64_t realtime_s) const {
  const Entry& entry = missions_.at(id);
  json reported = json_of(id, entry);
  reported.erase("id");
  reported.erase("findings");
  reported["by"] = text_of(whose(entry.by));
  reported["unix_time_s"] = realtime_s;
  std::string record = dump(reported);
  record.back() = ',';
  return record + R"("mission":)" + entry.run->canonical() + "}";
}

}  // namespace ledgerline::ground::service
