#include "ground/service/operators/sign_ins.hpp"

#include <algorithm>

#include "common/access/grants.hpp"

namespace ledgerline::ground::service {

std::vector<std::size_t> dismissed(const std::vector<Operator>& operators,
                                   const verification::RolesByOrganisation& roles) {
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

}  // namespace ledgerline::ground::service
