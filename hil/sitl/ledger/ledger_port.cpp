#include "hil/sitl/ledger/ledger_port.hpp"

#include <algorithm>
#include <limits>

#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {
namespace {

constexpr std::size_t stale_blocks = 5;
constexpr TimeNs stale_period_ns = 20 * ns_per_ms;

std::vector<fabric::Endorsement> endorsed_by(const fabric::Transaction& tx, const crypto::IdentityName& name) {
  const auto who = crypto::make_test_identity(name);
  const auto signature = who.signer->sign(tx.response_payload + who.serialized);
  return {{who.serialized, signature ? *signature : std::string()}};
}

void tamper_with(fabric::Transaction& tx, Tampering tampering) {
  switch (tampering) {
    case Tampering::signature:
      if (!tx.signature.empty()) tx.signature[0] ^= 1;
      tx.signature_verified = false;  // nobody has looked
      return;
    case Tampering::endorsement:
      tx.endorsements.clear();
      return;
    case Tampering::outsider:
      tx.endorsements = endorsed_by(tx, {"Org2MSP", "CN=peer0"});
      return;
    case Tampering::member:
      tx.endorsements = endorsed_by(tx, {"Org1MSP", "CN=User1@org1.ledgerline"});
      return;
    case Tampering::channel:
      tx.channel = "another";
      return;
    case Tampering::contract:
      tx.contract = "another";
      return;
    case Tampering::flag:
      tx.code = 11;  // MVCC_READ_CONFLICT
      return;
    case Tampering::stops:
      if (tx.function == contract::stop) tx.code = 11;
      return;
    case Tampering::none:
    case Tampering::chain:
    case Tampering::hash:
    case Tampering::number:
      return;
  }
}

void let_slip(fabric::Call& call, Slip slip) {
  CommandCall command;
  if (call.function != contract::command || !command.ParseFromString(call.args.at(0))) return;
  for (DronePlan& plan : *command.mutable_plans()) {
    if (slip == Slip::boot) plan.set_boot_id(plan.boot_id() ^ 1);
    if (slip == Slip::stamp) plan.set_state_stamp_ns(plan.state_stamp_ns() + 1);
    if (slip == Slip::speed && plan.setpoints_size() > 0) plan.mutable_setpoints(0)->set_vx(9);
    if (slip == Slip::late && plan.setpoints_size() > 0) {
      PlannedSetpoint& last = *plan.mutable_setpoints(plan.setpoints_size() - 1);
      last.set_at_ns(last.at_ns() + 10 * ns_per_s);
    }
  }
  call.args[0] = command.SerializeAsString();
}

}  // namespace

std::uint64_t LedgerCalls::add(TimeNs now, std::uint64_t id) {
  open_[next_] = {id, now + timeout_ns_};
  return next_++;
}

void LedgerCalls::end(const SimulatedLedger::Ended& ended) {
  const auto found = open_.find(ended.id);
  if (found == open_.end()) return;
  if (ended.outcome.kind == fabric::Outcome::Kind::committed) committed_.push_back(ended.outcome.tx_id);
  ended_.push_back({found->second.id, ended.outcome});
  open_.erase(found);
}

void LedgerCalls::fail(const std::string& why, TimeNs now) {
  for (auto call = open_.begin(); call != open_.end();) {
    const auto& [number, waiting] = *call++;  // end() erases it
    if (now < waiting.deadline_ns) continue;
    fabric::Outcome outcome;
    outcome.message = why;
    end({number, outcome});
  }
}

void LedgerCalls::forget() {
  open_.clear();
  ended_.clear();
}

void BlockDelivery::add(const VerifiedBlock& verified) {
  newest_.push_back(verified);
  if (newest_.size() > stale_blocks) newest_.pop_front();
  if (tampering_ == Tampering::none) {
    delivered_.push_back(verified);
    return;
  }
  fabric::Block block = *verified;
  if (tampering_ == Tampering::hash || tampering_ == Tampering::number) {
    fabric::Block empty = block;
    empty.transactions.clear();
    if (tampering_ == Tampering::number) ++empty.number;
    if (tampering_ == Tampering::hash) empty.previous_hash[0] ^= 1;
    delivered_.push_back(std::make_shared<const fabric::Block>(std::move(empty)));
  }
  if (tampering_ == Tampering::chain) block.previous_hash[0] ^= 1;
  for (fabric::Transaction& tx : block.transactions) tamper_with(tx, tampering_);
  delivered_.push_back(std::make_shared<const fabric::Block>(std::move(block)));
}

void BlockDelivery::step(TimeNs now) {
  if (!stale_ || now < next_stale_ns_) return;
  next_stale_ns_ = now + stale_period_ns;
  delivered_.insert(delivered_.end(), newest_.begin(), newest_.end());
}

LedgerPort::LedgerPort(SimulatedLedger& ledger, const crypto::IdentityName& name, std::uint64_t seed,
                       OneWayDelay::Direction way, double share, TimeNs timeout_ns)
    : ledger_(ledger),
      client_(ledger.add_client(name, way, share)),
      calls_(timeout_ns),
      reader_(ledger, seed),
      to_(seed),
      from_(~seed),
      peer_lags_(seed ^ 0x6c616773ULL) {
  begin();
}

TimeNs LedgerPort::Direction::arrival_ns(TimeNs now) {
  last_ns = std::max(last_ns, now + (delay ? draws.next(*delay) : 0));
  return last_ns;
}

void LedgerPort::submit(TimeNs now, std::uint64_t id, fabric::Call call) {
  const std::uint64_t number = calls_.add(now, id);
  if (cut_ || now < connect_at_ns_) {
    fabric::Outcome outcome;
    outcome.message = "not connected";
    calls_.end({number, outcome});
    return;
  }
  if (slip_ != Slip::none) let_slip(call, slip_);
  if (slip_ == Slip::twice && call.function == contract::command) send(now, calls_.add_copy(), call);
  send(now, number, std::move(call));
}

void LedgerPort::send(TimeNs now, std::uint64_t number, fabric::Call call) {
  requests_.push_back({to_.arrival_ns(now), number, std::move(call)});
}

void LedgerPort::cut(TimeNs now, bool away) {
  if (cut_ == away) return;
  cut_ = away;
  if (!away) {
    connect_at_ns_ = now + reconnect_ns;
    return;
  }
  connection_ = false;
  requests_.clear();
  outcomes_.clear();
  calls_.fail("the connection broke", std::numeric_limits<TimeNs>::max());
}

void LedgerPort::forget() {
  calls_.forget();
  requests_.clear();
  outcomes_.clear();
  delivery_.forget();
  reader_.end();
}

void LedgerPort::begin(std::optional<fabric::Checkpoint> from) {
  // What the ledger has by now the peer has, too.
  for (auto& [due, block] : std::exchange(blocks_, {})) reader_.add(0, std::move(block));
  for (auto& [due, block] : std::exchange(ordered_, {})) reader_.add_ordered(0, std::move(block));
  for (auto& block : ledger_.pop_blocks(std::numeric_limits<TimeNs>::max(), client_)) {
    if (reader_.reads_ordered()) reader_.add_ordered(0, block);
    reader_.add(0, std::move(block));
  }
  reader_.begin(std::move(from));
}

void LedgerPort::step(TimeNs now) {
  if (!cut_ && connect_at_ns_ != 0 && now >= connect_at_ns_) {
    connect_at_ns_ = 0;
    connection_ = reader_.connect();
  }
  const bool connected = !cut_ && connect_at_ns_ == 0;
  while (connected && !to_.stalled && !requests_.empty() && requests_.front().due_ns <= now) {
    ledger_.submit(now, client_, requests_.front().number, requests_.front().call);
    requests_.pop_front();
  }
  receive_from_ledger(now, connected);
  if (connected && !from_.stalled) deliver(now);
  calls_.fail("no answer in time", now);
}

void LedgerPort::receive_from_ledger(TimeNs now, bool connected) {
  for (auto& ended : ledger_.pop_outcomes(now, client_)) {
    // An answer to a broken connection is lost; the call ended with it.
    if (connected) outcomes_.emplace_back(from_.arrival_ns(now), std::move(ended));
  }
  for (auto& block : ledger_.pop_blocks(now, client_)) {
    const TimeNs due_ns = from_.arrival_ns(now);
    TimeNs lag_ns = 0;
    if (reader_.reads_ordered()) {
      ordered_.emplace_back(due_ns, block);
      lag_ns = static_cast<TimeNs>(peer_lags_.next() % static_cast<std::uint64_t>(max_peer_lag_ns));
    }
    last_peer_ns_ = std::max(last_peer_ns_, due_ns + lag_ns);
    blocks_.emplace_back(last_peer_ns_, std::move(block));
  }
}

void LedgerPort::deliver(TimeNs now) {
  for (; !outcomes_.empty() && outcomes_.front().first <= now; outcomes_.pop_front())
    calls_.end(outcomes_.front().second);
  for (; !ordered_.empty() && ordered_.front().first <= now; ordered_.pop_front())
    reader_.add_ordered(now, std::move(ordered_.front().second));
  if (!delivery_.stale()) {
    for (; !blocks_.empty() && blocks_.front().first <= now; blocks_.pop_front())
      reader_.add(now, std::move(blocks_.front().second));
    const Status read = reader_.read(now);
    for (const VerifiedBlock& block : reader_.pop_verified()) delivery_.add(block);
    if (!read) {
      connection_ = false;
      connect_at_ns_ = now + reconnect_ns;
    }
  }
  if (const std::string own = reader_.envelope_of_peer(now); !own.empty()) ledger_.order(now, own);
  delivery_.step(now);
}

}  // namespace ledgerline::hil
