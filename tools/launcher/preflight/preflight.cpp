#include "tools/launcher/preflight/preflight.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/launcher/preflight/fence.hpp"
#include "tools/launcher/preflight/records.hpp"

namespace ledgerline::fly {
namespace {

using nlohmann::json;

std::string text_in(const json& object, const char* key, const std::string& otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : otherwise;
}

void take_drone(const json& one, DroneFacts& drone) {
  const std::string phase = text_in(one, "phase", "disconnected");
  drone.there = phase != "disconnected";
  drone.phase = phase == "on_ground" || phase == "landed" ? "" : phase;
  drone.refusal = text_in(one, "cause", "unknown");
  if (drone.refusal == "none") drone.refusal.clear();
  const auto battery = one.find("battery");
  if (battery != one.end() && battery->is_number()) drone.battery = battery->get<double>();
  const auto temperature = one.find("temperature_c");
  if (temperature != one.end() && temperature->is_number() && temperature->get<double>() != 0)
    drone.temperature_c = temperature->get<double>();
  const auto age_ms = one.find("pose_age_ms");
  const auto position = one.find("position");
  drone.pose.reset();
  if (age_ms == one.end() || !age_ms->is_number() || position == one.end() || !position->is_array()) return;
  drone.pose = PoseFacts{.age_ms = age_ms->get<double>()};
  for (std::size_t k = 0; k < std::min<std::size_t>(3, position->size()); ++k)
    if ((*position)[k].is_number()) drone.pose->position_m[k] = (*position)[k].get<double>();
}

// For an error, in one line.
std::string said(const Line& line) {
  const std::string of = line.drone.empty() ? "" : line.drone + "'s ";
  return fmt::format("{}{}: {} (cure: {})", of, line.check, line.what, line.cure);
}

std::string bad_of(const std::vector<Line>& lines, const std::string& check = "") {
  std::vector<std::string> all;
  for (const Line& line : lines)
    if (line.verdict == Verdict::bad && (check.empty() || line.check == check)) all.push_back(said(line));
  return fmt::format("{}", fmt::join(all, "; "));
}

}  // namespace

Facts facts_of(const Options& options) {
  Facts facts;
  if (!options.own) return facts;
  const deployment::OwnDrones& own = *options.own;
  for (const deployment::OwnDrone& one : own.drones) {
    DroneFacts drone{.name = one.name, .address = one.address, .interface = one.interface};
    drone.wanted_serial = one.serial;
    facts.drones.push_back(std::move(drone));
  }
  facts.link = own.link;
  facts.pose_source = own.pose_source;
  facts.pose_topic = own.pose_topic;
  facts.stamps_count = own.pose_stamps_count;
  facts.enrols = !own.network || !own.network->admin.empty();
  facts.ledger.what = own.network ? "a network of others" : deployment::name_of(own.ledger);
  return facts;
}

std::string path_beyond(const Options& options, const Facts& facts) {
  if (options.manual || !options.own) return "";
  std::vector<Eigen::Vector2d> starts;
  for (const DroneFacts& drone : facts.drones) {
    if (!drone.pose) return "";
    starts.emplace_back(drone.pose->position_m[0], drone.pose->position_m[1]);
  }
  return beyond_fence(options, facts.link.fence, starts);
}

Preflight::Preflight(const Options& options) : options_(options), facts_(facts_of(options)) {}

void Preflight::take(const std::string& line) {
  const json message = json::parse(line, nullptr, false);
  const json link = message.is_object() ? message.value("link", json()) : json();
  const json list = link.is_object() ? link.value("drones", json()) : json();
  for (const json& one : list.is_array() ? list : json::array()) {
    if (!one.is_object()) continue;
    for (DroneFacts& drone : facts_.drones)
      if (text_in(one, "name", "") == drone.name) take_drone(one, drone);
  }
}

Status Preflight::take_records(const std::string& line, const crypto::IdentityName& self) {
  return fly::take_records(line, self, facts_);
}

void Preflight::acquired() {
  facts_.ledger.state = LedgerFacts::State::reached;
  for (DroneFacts& drone : facts_.drones) {
    if (drone.lease.holder != LeaseFacts::Holder::for_us) drone.lease = {.holder = LeaseFacts::Holder::ours};
  }
}

bool Preflight::acquires(const std::string& name) const {
  return std::none_of(facts_.drones.begin(), facts_.drones.end(), [&](const DroneFacts& drone) {
    return drone.name == name && drone.lease.holder == LeaseFacts::Holder::for_us;
  });
}

bool Preflight::ready() const { return !anything_bad(assess(facts_)); }

std::string Preflight::list() const {
  Facts facts = facts_;
  facts.path_beyond = path_beyond(options_, facts_);
  return words(assess(facts));
}

std::string Preflight::missing() const { return bad_of(assess(facts_)); }

Status Preflight::path_fits() const {
  const std::string why = path_beyond(options_, facts_);
  if (!why.empty()) return Error{why};
  return done;
}

Status Preflight::leases_fit() const {
  Facts facts = facts_;
  // Who is stopped can be acquired, and link waits for the end of the stop.
  for (DroneFacts& drone : facts.drones) drone.lease.stoppers.clear();
  const std::string why = bad_of(assess(facts), "lease");
  if (!why.empty()) return Error{why};
  return done;
}

}  // namespace ledgerline::fly
