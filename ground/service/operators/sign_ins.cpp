#include "ground/service/operators/sign_ins.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::ground::service {

std::string SignIns::refused(TimeNs now, std::size_t who) const {
  const Slot& slot = slots_[who];
  const TimeNs until_ns = slot.failed_ns + pause_ns;
  if (slot.failures < free_failures || now >= until_ns) return "";
  return "too many wrong pass phrases: wait " +
         std::to_string(static_cast<int>(std::ceil(to_seconds(until_ns - now)))) + " s";
}

void SignIns::failed(TimeNs now, std::size_t who) {
  ++slots_[who].failures;
  slots_[who].failed_ns = now;
}

void SignIns::begin(TimeNs now, std::size_t who, std::string_view token) {
  forget(slots_[who]);
  slots_[who] = {.token = crypto::sha256(token), .number = ++sessions_, .alive_ns = now};
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

bool SignIns::is_over(TimeNs now, std::string_view token) const {
  const crypto::Digest digest = crypto::sha256(token);
  return std::find(ended_.begin(), ended_.end(), digest) != ended_.end() ||
         std::any_of(slots_.begin(), slots_.end(),
                     [&](const Slot& slot) { return slot.token == digest && is_idle(now, slot); });
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
