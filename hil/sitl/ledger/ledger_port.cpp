#include "hil/sitl/ledger/ledger_port.hpp"

#include <algorithm>
#include <limits>

#include "common/base/enum_count.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/msg/contract.hpp"
#include "common/verification/calls.hpp"
#include "hil/sitl/peer/words.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {
namespace {

constexpr std::size_t stale_blocks = 5;
constexpr TimeNs stale_period_ns = 20 * ns_per_ms;

constexpr WordTable<Tampering, 11> all_lies{{{"chain", Tampering::chain},
                                             {"hash", Tampering::hash},
                                             {"number", Tampering::number},
                                             {"signature", Tampering::signature},
                                             {"endorsement", Tampering::endorsement},
                                             {"outsider", Tampering::outsider},
                                             {"member", Tampering::member},
                                             {"channel", Tampering::channel},
                                             {"contract", Tampering::contract},
                                             {"flag", Tampering::flag},
                                             {"stops", Tampering::stops}}};
static_assert(all_lies.size() + 1 == enum_count<Tampering>);  // none has no word
constexpr WordTable<Slip, 5> all_slips{{{"boot", Slip::boot},
                                        {"stamp", Slip::stamp},
                                        {"speed", Slip::speed},
                                        {"late", Slip::late},
                                        {"twice", Slip::twice}}};
static_assert(all_slips.size() + 1 == enum_count<Slip>);

std::vector<fabric::Endorsement> endorsed_by(const fabric::Transaction& tx, const crypto::IdentityName& name) {
  const auto who = crypto::make_test_identity(name);
  const auto signature = who.signer->sign(tx.response_payload + who.serialized);
  return {{who.serialized, signature ? *signature : std::string()}};
}

void lie_about(fabric::Transaction& tx, Tampering lie) {
  switch (lie) {
    case Tampering::signature:
      if (!tx.signature.empty()) tx.signature[0] ^= 1;
      tx.creator_fits = false;  // nobody has looked
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

std::optional<Tampering> lie_from(std::string_view word) { return value_of(all_lies, word); }
std::string lies() { return list_of(names_of(all_lies)); }
std::optional<Slip> slip_from(std::string_view word) { return value_of(all_slips, word); }
std::string slips() { return list_of(names_of(all_slips)); }

LedgerPort::LedgerPort(SimulatedLedger& ledger, const crypto::IdentityName& name, std::uint64_t seed, WayDelay::Way way,
                       double share, TimeNs timeout_ns)
    : ledger_(ledger),
      client_(ledger.add_client(name, way, share)),
      timeout_ns_(timeout_ns),
      draws_to_(seed),
      draws_from_(~seed),
      peer_(ledger.block(0), seed),
      orderer_(ledger.block(0), ~seed, test_orderer_keys()),
      lags_(seed ^ 0x6c616773ULL) {
  for (std::uint64_t number = 1; number < ledger.height(); ++number) peer_.add(0, ledger.block(number));
  begin();
}

// TCP keeps the order, whatever each piece is delayed by.
TimeNs LedgerPort::in_order(TimeNs due_ns, TimeNs& last_ns) {
  last_ns = std::max(last_ns, due_ns);
  return last_ns;
}

void LedgerPort::submit(TimeNs now, std::uint64_t id, fabric::Call call) {
  const std::uint64_t number = next_call_++;
  ++counts_.submitted;
  open_[number] = {id, now + timeout_ns_};
  if (cut_ || now < connect_at_ns_) {
    fabric::Outcome outcome;
    outcome.message = "not connected";
    end({number, outcome});
    return;
  }
  if (slip_ != Slip::none) let_slip(call, slip_);
  if (slip_ == Slip::twice && call.function == contract::command)
    send(now, next_call_++, call);  // nobody waits for the first
  send(now, number, std::move(call));
}

void LedgerPort::send(TimeNs now, std::uint64_t number, fabric::Call call) {
  to_.push_back({in_order(now + (delay_to_ ? draws_to_.next(*delay_to_) : 0), last_to_ns_), number, std::move(call)});
}

void LedgerPort::arrive(fabric::Block block) {
  if (lie_ == Tampering::hash || lie_ == Tampering::number) {
    fabric::Block empty = block;
    empty.transactions.clear();
    if (lie_ == Tampering::number) ++empty.number;
    if (lie_ == Tampering::hash) empty.previous_hash[0] ^= 1;
    arrived_blocks_.push_back(std::move(empty));
  }
  if (lie_ == Tampering::chain) block.previous_hash[0] ^= 1;
  for (fabric::Transaction& tx : block.transactions) lie_about(tx, lie_);
  arrived_blocks_.push_back(std::move(block));
}

void LedgerPort::end(const SimulatedLedger::Ended& ended) {
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
  open_.clear();
  to_.clear();
  outcomes_.clear();
  arrived_blocks_.clear();
  arrived_outcomes_.clear();
  contradictions_.clear();
  refused_blocks_.clear();
  reading_ = false;
}

void LedgerPort::begin(std::optional<fabric::Checkpoint> from) {
  // What the ledger has by now the peer has, too.
  const auto take = [this](SimulatedLedger::BlockPtr block) { peer_.add(0, std::move(block)); };
  for (auto& [due, block] : std::exchange(blocks_, {})) take(std::move(block));
  for (auto& [due, block] : std::exchange(ordered_, {})) orderer_.add(0, std::move(block));
  for (auto& block : ledger_.take_blocks(std::numeric_limits<TimeNs>::max(), client_)) {
    if (source_ != fabric::BlockSource::peer) orderer_.add(0, block);
    take(std::move(block));
  }
  auto intake = fabric::BlockIntake::make(
      {.where = ledger_.where(),
       .config_block = ledger_.block(0)->SerializeAsString(),
       .make_registry =
           [](const std::vector<crypto::MspRoot>& roots) {
             std::vector<std::string> names;
             for (const auto& one : roots) names.push_back(one.msp_id);
             return crypto::make_test_registry(names);
           },
       .likely_policy = [](const std::string& key) { return verification::likely_policy(key); },
       .is_of_hot_path = [](const std::string& key) { return verification::is_of_hot_path(key); },
       .real_time = [this] { return SimulatedLedger::real(now_); },
       .source = source_});
  orderer_connected_ = false;
  intake_ = std::move(intake).value();
  checkpoint_ = std::move(from);
  newest_verified_ = checkpoint_;
  if (!checkpoint_) intake_->start_at(peer_.height());
  reading_ = true;
}

std::optional<fabric::Checkpoint> LedgerPort::checkpoint() const { return newest_verified_; }

void LedgerPort::refuse(const common::Block& message) {
  if (auto block = fabric::decode_block(message)) refused_blocks_.push_back(std::move(*block));
}

// As fabric::BlockHandOver: behind a contradiction both streams go on for what counts by its signature alone.
void LedgerPort::read_on(TimeNs now) {
  const std::uint64_t first = *intake_->next_of_peer();
  next_refused_ = std::max(next_refused_, first);
  next_ordered_refused_ = std::max(next_ordered_refused_, first);
  std::size_t sent = 0;
  const auto read = [&](ServingPeer& from, std::uint64_t& next) {
    for (; const auto message = from.serve(now, next); ++next, ++sent) refuse(*message);
  };
  read(peer_, next_refused_);
  if (source_ != fabric::BlockSource::peer) read(orderer_, next_ordered_refused_);
  if (sent == 0 || now < next_contradiction_ns_) return;
  next_contradiction_ns_ = now + ns_per_s;
  contradictions_.push_back(intake_->contradiction());
}

void LedgerPort::leave_peer(TimeNs now, const std::string& why) {
  contradictions_.push_back(why);
  connection_ = false;
  connect_at_ns_ = now + reconnect_ns;
}

/// False: the peer's chain does not continue the checkpoint, or it does not say.
bool LedgerPort::find_place(TimeNs now) {
  if (!checkpoint_) return true;
  const auto newest = peer_.newest(now);
  if (!newest) return false;
  const auto on = intake_->continue_chain({*checkpoint_, max_absence_blocks}, *newest,
                                          [this](std::uint64_t number) { return peer_.fetch(number); });
  if (!on) {
    leave_peer(now, on.error().what);
    return false;
  }
  checkpoint_.reset();
  return true;
}

void LedgerPort::read_blocks(TimeNs now) {
  if (!find_place(now)) return;
  if (!intake_->contradiction().empty()) return read_on(now);
  read_ordered(now);
  while (const auto message = peer_.serve(now, *intake_->next_of_peer())) {
    if (intake_->confirms_next()) {
      if (const auto confirmed = intake_->confirm(*message); !confirmed) {
        refuse(*message);
        return leave_peer(now, confirmed.error().what);
      }
    } else {
      auto block = intake_->take(*message, [this](std::uint64_t number) { return peer_.fetch(number); });
      if (!block) {
        refuse(*message);
        return leave_peer(now, block.error().what);
      }
      hand_over(std::move(*block));
    }
    (void)take_ordered(now);
  }
}

void LedgerPort::leave_orderer(TimeNs now, const std::string& why) {
  contradictions_.push_back(why);
  orderer_connected_ = false;
  orderer_at_ns_ = now + reconnect_ns;
}

void LedgerPort::read_ordered(TimeNs now) {
  if (source_ == fabric::BlockSource::peer) return;
  if (!orderer_connected_ && (now < orderer_at_ns_ || !intake_->begin_ordered())) return;
  orderer_connected_ = true;
  while (orderer_connected_) {
    const auto message = orderer_.serve(now, *intake_->next_ordered());
    if (!message) return;
    if (const Status added = intake_->add_ordered(*message); !added) {
      refuse(*message);
      return leave_orderer(now, added.error().what);
    }
    if (!take_ordered(now)) return;
  }
}

/// False: what an orderer has delivered is refused.
bool LedgerPort::take_ordered(TimeNs now) {
  while (true) {
    auto ordered = intake_->take_ordered();
    if (!ordered) {
      leave_orderer(now, ordered.error().what);
      return false;
    }
    if (!*ordered) return true;
    ++counts_.ordered_blocks;
    hand_over(std::move((*ordered)->block));
  }
}

void LedgerPort::hand_over(fabric::Block block) {
  newest_verified_ = {ledger_.where().channel,
                      block.number,
                      fabric::block_header_hash(block.number, block.previous_hash, block.data_hash),
                      {}};
  newest_.push_back(block);
  if (newest_.size() > stale_blocks) newest_.pop_front();
  ++counts_.blocks;
  arrive(std::move(block));
}

void LedgerPort::step(TimeNs now) {
  now_ = now;
  if (!cut_ && connect_at_ns_ != 0 && now >= connect_at_ns_) {
    connect_at_ns_ = 0;
    connection_ = intake_->contradiction().empty();
    intake_->begin();
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
    TimeNs lag_ns = 0;
    if (source_ != fabric::BlockSource::peer) {
      ordered_.emplace_back(due_ns, block);
      lag_ns = static_cast<TimeNs>(lags_.next() % static_cast<std::uint64_t>(max_peer_lag_ns));
    }
    blocks_.emplace_back(in_order(due_ns + lag_ns, last_peer_ns_), std::move(block));
  }
  if (connected && !stalled_from_) {
    for (; !outcomes_.empty() && outcomes_.front().first <= now; outcomes_.pop_front()) end(outcomes_.front().second);
    for (; !ordered_.empty() && ordered_.front().first <= now; ordered_.pop_front())
      orderer_.add(now, std::move(ordered_.front().second));
    for (; !stale_ && !blocks_.empty() && blocks_.front().first <= now; blocks_.pop_front())
      peer_.add(now, std::move(blocks_.front().second));
    if (!stale_ && reading_) read_blocks(now);
    if (const std::string own = peer_.orders(now); !own.empty()) ledger_.order(now, own);
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

std::vector<SimulatedLedger::Ended> LedgerPort::take_outcomes() { return std::exchange(arrived_outcomes_, {}); }

std::optional<bool> LedgerPort::take_connection() { return std::exchange(connection_, std::nullopt); }

}  // namespace ledgerline::hil
