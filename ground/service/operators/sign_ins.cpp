#include "ground/service/operators/sign_ins.hpp"

#include <algorithm>

#include "common/access/access.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/stops.hpp"

namespace ledgerline::ground::service {

std::vector<std::size_t> dismissed(const std::vector<Operator>& operators, const verification::Roles& roles) {
  std::vector<std::size_t> found;
  for (std::size_t who = 0; who < operators.size(); ++who) {
    const Role role = roles.of(operators[who].identity);
    if (role != ROLE_NONE && !is_operator(role)) found.push_back(who);
  }
  return found;
}

std::optional<TimeNs> Attempts::next_attempt(TimeNs now, const std::string& address) {
  const auto found = addresses_.find(address);
  const int failures = found == addresses_.end() ? 0 : found->second.failures;
  if (failures < free_of_address && failures_ < free_of_all) return now;
  const auto waiting =
      std::ranges::count_if(addresses_, [&](const auto& one) { return now < one.second.waits_until_ns; });
  if (static_cast<std::size_t>(waiting) >= max_waiting) return std::nullopt;
  if (found != addresses_.end() && now < found->second.waits_until_ns) return std::nullopt;
  // An address of which nothing is known any more has none free, either: failures_ has counted those.
  if (found == addresses_.end() && addresses_.size() >= max_addresses) {
    const auto idle =
        std::ranges::find_if(addresses_, [&](const auto& one) { return now >= one.second.waits_until_ns; });
    addresses_.erase(idle);
  }
  return addresses_[address].waits_until_ns = now + pause_ns;
}

void Attempts::failed(const std::string& address) {
  ++failures_;
  if (addresses_.contains(address) || addresses_.size() < max_addresses) ++addresses_[address].failures;
}

void SignIns::begin(TimeNs now, std::size_t who, std::string_view token) {
  forget(slots_[who]);
  Slot& slot = slots_[who];
  slot.token = crypto::sha256(token);
  slot.number = ++sessions_;
  slot.alive_ns = now;
}

std::optional<SignIns::Session> SignIns::of(TimeNs now, std::string_view token) {
  const crypto::Digest digest = crypto::sha256(token);
  for (std::size_t who = 0; who < slots_.size(); ++who) {
    const Session session{who, slots_[who].number};
    if (slots_[who].token == digest && touch(now, session)) return session;
  }
  return std::nullopt;
}

bool SignIns::touch(TimeNs now, const Session& session) {
  Slot& slot = slots_[session.who];
  if (!slot.token || slot.number != session.number || is_idle(now, slot)) return false;
  slot.alive_ns = now;
  return true;
}

void SignIns::end(const Session& session) {
  if (slots_[session.who].number == session.number) forget(slots_[session.who]);
}

std::vector<std::size_t> SignIns::dismiss(std::vector<std::size_t> who) {
  dismissed_ = std::move(who);
  std::vector<std::size_t> ended;
  for (std::size_t one = 0; one < slots_.size(); ++one) {
    if (!slots_[one].token || !is_dismissed(one)) continue;
    forget(slots_[one]);
    ended.push_back(one);
  }
  return ended;
}

bool SignIns::is_dismissed(std::size_t who) const { return std::ranges::find(dismissed_, who) != dismissed_.end(); }

bool SignIns::is_over(TimeNs now, std::string_view token) const {
  const crypto::Digest digest = crypto::sha256(token);
  return std::ranges::find(ended_, digest) != ended_.end() ||
         std::ranges::any_of(slots_, [&](const Slot& slot) { return slot.token == digest && is_idle(now, slot); });
}

void SignIns::forget(Slot& slot) {
  if (!slot.token) return;
  if (ended_.size() == max_ended) ended_.pop_front();
  ended_.push_back(*slot.token);
  slot.token.reset();
}

std::vector<std::size_t> SignIns::expire(TimeNs now) {
  std::vector<std::size_t> over;
  for (std::size_t who = 0; who < slots_.size(); ++who) {
    Slot& slot = slots_[who];
    if (!slot.token || !is_idle(now, slot)) continue;
    forget(slot);
    over.push_back(who);
  }
  return over;
}

bool is_aloft(const FlightView& flights, std::size_t drone) {
  const IntakeState& seen = flights.intake(drone);
  return is_flown(flights.status(drone).phase) || (seen.has_state && in_flight(seen.state.phase));
}

std::vector<std::size_t> aloft_of(const FlightView& flights) {
  std::vector<std::size_t> aloft;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    if (is_aloft(flights, drone) || !flights.intake(drone).has_state) aloft.push_back(drone);
  }
  return aloft;
}

std::vector<std::size_t> stopped_of(const FlightView& flights) {
  std::vector<std::size_t> stopped;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    if (flights.lease(drone).stoppers.stoppers_size() > 0) stopped.push_back(drone);
  }
  return stopped;
}

std::vector<std::size_t> stopped_by_ground(const FlightView& flights) {
  const Identity ground = to_message(flights.config().self);
  std::vector<std::size_t> stopped;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    const Control& stoppers = flights.lease(drone).stoppers;
    // A ground that is a supervisor would clear the others' stops with its own.
    if (stoppers.stoppers_size() == 1 && is_stopped_by(stoppers, ground)) stopped.push_back(drone);
  }
  return stopped;
}

HeldDrones drones_held_by(const FlightView& flights, const crypto::IdentityName& who) {
  HeldDrones held;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    if (flights.lease(drone).holder != who || flights.lease(drone).commander != flights.config().self) continue;
    held.drones.push_back(drone);
    if (is_aloft(flights, drone)) held.aloft.push_back(drone);
  }
  return held;
}

void EndedSessions::add(std::size_t who, TimeNs from_ns) {
  remove(who);
  all_.push_back({who, from_ns, from_ns + limit_ns, from_ns});
}

void EndedSessions::remove(std::size_t who) {
  std::erase_if(all_, [&](const Gone& one) { return one.who == who; });
}

bool EndedSessions::has(std::size_t who) const {
  return std::ranges::any_of(all_, [&](const Gone& one) { return one.who == who; });
}

std::vector<std::size_t> EndedSessions::all() const {
  std::vector<std::size_t> who;
  for (const Gone& one : all_) who.push_back(one.who);
  return who;
}

EndedSessions::Step EndedSessions::step(TimeNs now_ns, std::size_t who, const HeldDrones& held) {
  const auto gone = std::ranges::find_if(all_, [&](const Gone& one) { return one.who == who; });
  Step step;
  if (gone == all_.end() || now_ns < gone->from_ns) return step;
  step.last = now_ns >= gone->until_ns;
  step.give_back = held.aloft.empty() || step.last;
  if (step.give_back || now_ns < gone->next_ns) return step;
  gone->next_ns = now_ns + again_ns;
  step.land = held.aloft;
  return step;
}

}  // namespace ledgerline::ground::service
