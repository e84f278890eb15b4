#include "hil/ledger_port.hpp"

#include <algorithm>
#include <limits>

namespace ledgerline::hil {
namespace {

constexpr std::size_t stale_blocks = 5;
constexpr TimeNs stale_period_ns = 20 * ns_per_ms;

}  // namespace

LedgerPort::LedgerPort(VirtualLedger& ledger, const crypto::IdentityName& name, std::uint64_t seed)
    : ledger_(ledger), client_(ledger.add_client(name)), draws_to_(seed), draws_from_(~seed) {}

// TCP keeps the order, whatever each piece is delayed by.
TimeNs LedgerPort::in_order(TimeNs due_ns, TimeNs& last_ns) {
  last_ns = std::max(last_ns, due_ns);
  return last_ns;
}

void LedgerPort::submit(TimeNs now, std::uint64_t id, fabric::Call call) {
  const std::uint64_t number = next_call_++;
  ++counts_.submitted;
  open_[number] = {id, now + deadline_ns};
  if (cut_ || now < connect_at_ns_) {
    fabric::Outcome outcome;
    outcome.message = "not connected";
    end({number, outcome});
    return;
  }
  to_.push_back({in_order(now + (delay_to_ ? draws_to_.next(*delay_to_) : 0), last_to_ns_), number, std::move(call)});
}

void LedgerPort::end(const VirtualLedger::Ended& ended) {
  const auto found = open_.find(ended.id);
  if (found == open_.end()) return;  // given up, or of a process that is gone
  using Kind = fabric::Outcome::Kind;
  switch (ended.outcome.kind) {
    case Kind::committed:
      ++counts_.committed;
      acknowledged_.push_back(ended.outcome.tx_id);
      break;
    case Kind::invalidated:
      ++counts_.invalidated;
      break;
    case Kind::refused:
      ++counts_.refused;
      break;
    case Kind::unavailable:
    case Kind::overloaded:
      ++counts_.unavailable;
      break;
  }
  arrived_outcomes_.push_back({found->second.first, ended.outcome});
  open_.erase(found);
}

void LedgerPort::cut(TimeNs now, bool away) {
  if (cut_ == away) return;
  cut_ = away;
  if (!away) {
    connect_at_ns_ = now + reconnect_ns;
    return;
  }
  connection_ = false;
  to_.clear();
  outcomes_.clear();
  const auto open = open_;
  for (const auto& [number, call] : open) {
    fabric::Outcome outcome;
    outcome.message = "the connection broke";
    end({number, outcome});
  }
}

void LedgerPort::forget() {
  (void)ledger_.take_blocks(std::numeric_limits<TimeNs>::max(), client_);
  open_.clear();
  to_.clear();
  outcomes_.clear();
  blocks_.clear();
  arrived_blocks_.clear();
  arrived_outcomes_.clear();
}

void LedgerPort::step(TimeNs now) {
  if (!cut_ && connect_at_ns_ != 0 && now >= connect_at_ns_) {
    connect_at_ns_ = 0;
    connection_ = true;
  }
  const bool connected = !cut_ && connect_at_ns_ == 0;
  while (connected && !stalled_to_ && !to_.empty() && to_.front().due_ns <= now) {
    ledger_.submit(now, client_, to_.front().id, to_.front().call);
    to_.pop_front();
  }
  for (auto& ended : ledger_.take_outcomes(now, client_)) {
    // An answer to a broken connection is lost; the call ended with it.
    if (connected) {
      const TimeNs due_ns = in_order(now + (delay_from_ ? draws_from_.next(*delay_from_) : 0), last_from_ns_);
      outcomes_.emplace_back(due_ns, std::move(ended));
    }
  }
  for (auto& block : ledger_.take_blocks(now, client_)) {
    const TimeNs due_ns = in_order(now + (delay_from_ ? draws_from_.next(*delay_from_) : 0), last_from_ns_);
    blocks_.emplace_back(due_ns, std::move(block));
  }
  if (connected && !stalled_from_) {
    for (; !outcomes_.empty() && outcomes_.front().first <= now; outcomes_.pop_front()) end(outcomes_.front().second);
    for (; !stale_ && !blocks_.empty() && blocks_.front().first <= now; blocks_.pop_front()) {
      newest_.push_back(blocks_.front().second);
      if (newest_.size() > stale_blocks) newest_.pop_front();
      ++counts_.blocks;
      arrived_blocks_.push_back(std::move(blocks_.front().second));
    }
    if (stale_ && now >= next_stale_ns_) {
      next_stale_ns_ = now + stale_period_ns;
      counts_.stale_blocks += newest_.size();
      arrived_blocks_.insert(arrived_blocks_.end(), newest_.begin(), newest_.end());
    }
  }
  std::vector<std::uint64_t> given_up;
  for (const auto& [number, call] : open_) {
    if (now >= call.second) given_up.push_back(number);
  }
  for (const std::uint64_t number : given_up) {
    fabric::Outcome outcome;
    outcome.message = "no answer in time";
    end({number, outcome});
  }
}

std::vector<fabric::Block> LedgerPort::take_blocks() { return std::exchange(arrived_blocks_, {}); }

std::vector<VirtualLedger::Ended> LedgerPort::take_outcomes() { return std::exchange(arrived_outcomes_, {}); }

std::optional<bool> LedgerPort::take_connection() { return std::exchange(connection_, std::nullopt); }

}  // namespace ledgerline::hil
