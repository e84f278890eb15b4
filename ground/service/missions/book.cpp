#include "ground/service/missions/book.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "ground/json/strict.hpp"
#include "ground/mission/drone_now.hpp"

namespace ledgerline::ground::service {
namespace {

using mission::MissionRun;
using mission::RunPhase;
using ground::json::dump;
using nlohmann::json;

constexpr std::size_t id_digits = 12;
constexpr TimeNs landing_ns = 60 * ns_per_s;  // so long the drones of an aborted one are looked after
constexpr std::size_t max_told_findings = 20;
constexpr int max_kept_depth = 8;

Error unknown(const std::string& id) { return Error{fmt::format("there is no mission \"{}\"", id.substr(0, 64))}; }

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

Result<std::string> MissionBook::put(MissionRun run, std::optional<crypto::IdentityName> by) {
  const std::string id = crypto::hex(run.digest()).substr(0, id_digits);
  if (has(id)) return Error{fmt::format("mission {} is here already, as {}", run.mission().name, id)};
  if (missions_.size() >= max_missions)
    return Error{fmt::format("there are {} missions already: remove one", max_missions)};
  Entry entry{.run = std::make_unique<MissionRun>(std::move(run)), .by = std::move(by)};
  entry.phase = entry.run->phase();
  entry.stirred = entry.run->active() || entry.phase == RunPhase::aborted;  // a restored one has drones to find
  missions_.emplace(id, std::move(entry));
  changed_ = true;
  return id;
}

Result<std::string> MissionBook::add(mission::Mission mission) {
  auto run = MissionRun::make(std::move(mission), settings_.run);
  if (!run) return run.error();
  return put(std::move(*run), std::nullopt);
}

Result<std::string> MissionBook::restore(std::string_view text) {
  const auto kept = ground::json::object_from(text, "the kept mission", max_kept_depth);
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
  return put(std::move(*run), std::move(by));
}

Status MissionBook::remove(const std::string& id) {
  const Entry* entry = find(id);
  if (entry == nullptr) return unknown(id);
  if (entry->run->active()) return Error{fmt::format("mission {} is flown", entry->run->mission().name)};
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
    if (std::find(settings_.approvers.begin(), settings_.approvers.end(), signer.msp_id) == settings_.approvers.end())
      continue;
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

Status MissionBook::whole_lease(const Entry& entry, const std::optional<crypto::IdentityName>& by,
                                const FlightCore& core) const {
  const crypto::IdentityName& who = by ? *by : self_;
  for (const mission::MissionDrone& one : entry.run->mission().drones) {
    const auto drone = index_of(core.drones(), one.drone);
    if (!drone) continue;  // a finding
    const Lease& lease = core.lease(*drone);
    if (lease.holder != who || lease.commander != core.config().self) {
      return Error{fmt::format("{}: its lease is {}: take control of it first", one.drone,
                               lease.holder ? "held by " + holder_words(lease) : "nobody's")};
    }
    for (const auto& [id, other] : missions_) {
      const auto& drones = other.run->mission().drones;
      const bool has_it =
          std::any_of(drones.begin(), drones.end(), [&](const auto& d) { return d.drone == one.drone; });
      if (other.run->active() && has_it)
        return Error{fmt::format("{} flies in mission {}", one.drone, other.run->mission().name)};
    }
  }
  return done;
}

Status MissionBook::start(const std::string& id, const std::optional<crypto::IdentityName>& by,
                          const std::vector<mission::Finding>& findings, const FlightCore& core) {
  Entry* entry = find(id);
  if (entry == nullptr) return unknown(id);
  if (!core.config().manual) return Error{"this flight flies a path of its own"};
  set_findings(id, findings);
  if (const Status held = whole_lease(*entry, by, core); !held) return held;
  if (const Status started = entry->run->start(findings); !started) return started;
  entry->by = by;
  entry->stirred = true;
  return done;
}

Status MissionBook::pause(const std::string& id) {
  Entry* entry = find(id);
  if (entry == nullptr) return unknown(id);
  if (const Status paused = entry->run->pause(); !paused) return paused;
  changed_ = entry->stirred = true;
  return done;
}

Status MissionBook::resume(const std::string& id) {
  Entry* entry = find(id);
  if (entry == nullptr) return unknown(id);
  if (const Status resumed = entry->run->resume(); !resumed) return resumed;
  changed_ = entry->stirred = true;
  return done;
}

Status MissionBook::land(const std::string& id, const std::string& why) {
  Entry* entry = find(id);
  if (entry == nullptr) return unknown(id);
  if (const Status ended = entry->run->end(why); !ended) return ended;
  changed_ = entry->stirred = true;
  return done;
}

bool MissionBook::busy() const {
  return std::any_of(missions_.begin(), missions_.end(),
                     [](const auto& one) { return one.second.stirred || one.second.run->active(); });
}

MissionBook::Outputs MissionBook::step(TimeNs now, const FlightCore& core) {
  std::vector<mission::DroneNow> drones;
  for (std::size_t i = 0; i < core.drones().size(); ++i) drones.push_back(mission::drone_now(core, i));
  Outputs out;
  for (auto& [id, entry] : missions_) {
    if (!entry.stirred && !entry.run->active()) continue;
    if (entry.run->phase() == RunPhase::aborted && entry.quiet_ns == 0) entry.quiet_ns = now + landing_ns;
    entry.stirred = now < entry.quiet_ns;
    mission::RunOutputs made = entry.run->step(now, drones);
    for (PilotWish& wish : made.wishes) {
      wish.by = entry.by;
      out.wishes.push_back(std::move(wish));
    }
    out.events.insert(out.events.end(), made.events.begin(), made.events.end());
    if (made.changed) out.kept.push_back(id);
    changed_ = changed_ || made.changed;
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
    if (findings.size() >= max_told_findings) break;
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
  json shown = json_of(id, entry), paths = json::object();
  for (const mission::MissionDrone& drone : entry.run->mission().drones) {
    json path = json::array();
    for (const motion::Waypoint& waypoint : drone.way())
      path.push_back(
          {waypoint.at_m.x(), waypoint.at_m.y(), waypoint.height_m.value_or(settings_.check.flight.height_m)});
    paths[drone.drone] = std::move(path);
  }
  shown["paths"] = std::move(paths);
  return dump(shown);
}

std::string MissionBook::keep(const std::string& id) const {
  const Entry& entry = missions_.at(id);
  json kept{{"run", json::parse(entry.run->saved())}};
  kept["by"] = entry.by ? json::array({entry.by->msp_id, entry.by->subject}) : json();
  return dump(kept);
}

std::string MissionBook::record(const std::string& id, std::int64_t realtime_s) const {
  const Entry& entry = missions_.at(id);
  json record = json_of(id, entry);
  record.erase("id");
  record.erase("findings");
  record["by"] = text_of(entry.by ? *entry.by : self_);
  record["unix_time_s"] = realtime_s;
  record["mission"] = json::parse(mission::canonical(entry.run->mission()));
  return dump(record);
}

}  // namespace ledgerline::ground::service
