#include "hil/sitl/ledger/simulated_ledger.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <charconv>
#include <cmath>
#include <utility>

#include "common/msg/contract.hpp"
#include "common/msg/ros.hpp"
#include "common/verification/calls.hpp"
#include "ledgerline.pb.h"
#include "peer/proposal_response.pb.h"

namespace ledgerline::hil {
namespace {

// A moment in 2026, so that blocks carry plausible times; real time on the simulated clock is this plus the clock.
constexpr TimeNs real_epoch_ns = 1'767'225'600 * ns_per_s;

const std::vector<std::string> organisations{"Org1MSP", "Org2MSP", "Org3MSP"};

node::Now at(TimeNs now) { return {now, real_epoch_ns + now}; }

constexpr TimeNs draw_period_ns = 100 * ns_per_ms;
constexpr double max_added_s = 3;

Result<AddedDelay> recorded_from(const std::string& file, const ReadRecording& read) {
  auto recording = read(file);
  if (!recording) return recording.error();
  const TimeNs max_delay = *std::max_element((*recording)->begin(), (*recording)->end());
  if (max_delay > from_seconds(max_added_s))
    return Error{
        fmt::format("{}: {} s is longer than the {} s that can be added", file, to_seconds(max_delay), max_added_s)};
  return AddedDelay{.own = Distribution{Distribution::Kind::recorded, 0, 0, std::move(*recording), file}};
}

const std::string& reason_of(const node::Reply& reply) { return reply.detail.empty() ? reply.message : reply.detail; }

}  // namespace

double PublishedDelay::quantile(double share) const {
  std::size_t to = 1;
  while (to + 1 < shares.size() && share >= shares[to]) ++to;
  const double part = (share - shares[to - 1]) / (shares[to] - shares[to - 1]);
  return quantiles_s[to - 1] + part * (quantiles_s[to] - quantiles_s[to - 1]);
}

Result<AddedDelay> added_delay_from(const std::string& text, const ReadRecording& read) {
  if (text == "none") return AddedDelay{};
  const auto* known = std::find_if(published_delays.begin(), published_delays.end(),
                                   [&](const PublishedDelay& one) { return one.name == text; });
  if (known != published_delays.end()) return AddedDelay{.published = known};
  double seconds = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  if (error != std::errc{} || end != text.data() + text.size()) return recorded_from(text, read);
  if (!(seconds >= 0 && seconds <= max_added_s))
    return Error{fmt::format("{} is no delay from 0 to {} seconds", text, max_added_s)};
  return AddedDelay{.own = Distribution::constant(from_seconds(seconds))};
}

TimeNs OneWayDelay::draw() {
  if (delay_.published) return from_seconds(delay_.published->quantile(random_.uniform()));
  return delay_.own ? draws_of_own_.next(*delay_.own) : 0;
}

TimeNs OneWayDelay::at(TimeNs now) {
  const auto period = static_cast<std::uint64_t>(now / draw_period_ns);
  while (drawn_ <= period) draws_[drawn_++ % kept] = draw();
  const auto part = [&](std::uint64_t k, double share) {
    return std::llround(static_cast<double>(draws_[k % kept]) * share);
  };
  std::uint64_t chosen = period;
  if (direction_ == Direction::back) {
    const std::uint64_t oldest = period - std::min(period, kept - 1);
    const auto begin = [](std::uint64_t k) { return static_cast<TimeNs>(k) * draw_period_ns; };
    while (chosen > oldest && begin(chosen) + part(chosen, 1 - share_) > now) --chosen;
  }
  return part(chosen, share_);
}

SimulatedLedger::SimulatedLedger(const node::CoreConfig& config, const LedgerDelays& delays, std::uint64_t seed)
    : config_(config), delays_(delays), where_{config.channel, config.contract}, random_(seed) {
  std::vector<std::string> msp_ids = organisations;
  for (const std::string& msp_id : msp_ids) config_.organisations.push_back({msp_id, "test authority of " + msp_id});
  config_.orderers = {"OrdererMSP", "test authority of OrdererMSP"};
  msp_ids.push_back(config_.orderers.msp_id);
  registry_ = crypto::make_test_registry(msp_ids);
  open();
}

// From what the store has; the first time it is empty.
void SimulatedLedger::open() {
  std::vector<crypto::SigningIdentity> peers;
  for (const auto& msp_id : organisations) peers.push_back(crypto::make_test_identity({msp_id, "CN=peer0"}));
  core_ = std::make_unique<node::NodeCore>(config_, registry_, peers,
                                           crypto::make_test_identity({"OrdererMSP", "CN=orderer"}),
                                           [this](std::uint64_t number) { return store_->read(number); });
  auto store = node::BlockStore::open(
      files_, [this](std::string_view block) { return core_->replay(std::string(block)); }, [](const std::string&) {});
  assert(store.ok());
  store_ = std::move(*store);
  if (store_->height() == 0) apply(0, core_->genesis());
}

void SimulatedLedger::restart(TimeNs now) {
  files_.cut_power();
  open();
  writing_.reset();
  const auto lose = [&](const Pending& pending) {
    fabric::Outcome outcome;
    outcome.tx_id = pending.tx_id;
    outcome.message = "the node ended";
    members_[pending.client].outcomes.emplace_back(later(now, delays_.deliver_ns), Ended{pending.id, outcome});
  };
  for (const auto& [due, pending] : due_) lose(pending);
  for (const auto& [waiter, pending] : waiting_) lose(pending);
  due_.clear();
  waiting_.clear();
}

std::vector<std::string> SimulatedLedger::blocks() const {
  std::vector<std::string> blocks;
  for (std::uint64_t number = 0; number < store_->height(); ++number) {
    auto block = store_->read(number);
    assert(block.ok());
    blocks.push_back(std::move(*block));
  }
  return blocks;
}

SimulatedLedger::Client SimulatedLedger::add_client(const crypto::IdentityName& name, OneWayDelay::Direction way,
                                                    double share) {
  members_.push_back({crypto::make_test_identity(name), OneWayDelay(delays_.added, way, share, added_seed_), {}, {}});
  return members_.size() - 1;
}

Result<fabric::Proposal> SimulatedLedger::propose(TimeNs now, const Member& member, const fabric::Call& call) {
  std::string nonce(24, '\0');
  for (char& c : nonce) c = static_cast<char>(random_.next());
  return fabric::make_proposal(member.identity, where_, call, real_epoch_ns + now, nonce);
}

TimeNs SimulatedLedger::later(TimeNs now, TimeNs delay) {
  return now + delay + static_cast<TimeNs>(random_.uniform() * static_cast<double>(delays_.jitter_ns));
}

void SimulatedLedger::submit(TimeNs now, Client client, std::uint64_t id, const fabric::Call& call) {
  Pending pending{client, id, {}, call, {}, false, now, 0};
  if (asked_) asked_(call);
  const auto proposal = propose(now, members_[client], call);
  if (!proposal) {
    end(now, pending, {node::Code::invalid_argument, proposal.error().message, {}, {}});
    return;
  }
  pending.tx_id = proposal->tx_id;
  pending.bytes = proposal->signed_proposal;
  due_.emplace(later(now, delays_.endorse_ns), std::move(pending));
}

void SimulatedLedger::end(TimeNs now, const Pending& pending, const node::Reply& refusal) {
  auto outcome = fabric::Outcome::failed(fabric::Outcome::Kind::refused, reason_of(refusal));
  outcome.tx_id = pending.tx_id;
  Member& member = members_[pending.client];
  member.outcomes.emplace_back(delivered(now, member), Ended{pending.id, outcome});
}

TimeNs SimulatedLedger::delivered(TimeNs now, Member& member) {
  return later(now, delays_.deliver_ns) + member.added.at(now);
}

// As fabric::Client does.
Result<std::string> SimulatedLedger::sign(const Pending& pending, const std::string& honest) {
  const std::string envelope = relay_.tamper(pending.call, honest);
  fabric::EventCheck event_check;
  if (relay_.compared()) {
    event_check = [&](std::string_view name, std::string_view payload) {
      return verification::check_event({pending.call.function, pending.call.args}, name, payload);
    };
  }
  const auto prepared = fabric::check_prepared({pending.tx_id, pending.bytes}, envelope, event_check);
  if (!prepared) return prepared.error();
  return fabric::sign_envelope(members_[pending.client].identity, envelope);
}

void SimulatedLedger::advance(TimeNs now, Pending pending) {
  if (!pending.endorsed) {
    node::Reply reply = core_->endorse(pending.bytes, at(now));
    if (reply.code != node::Code::ok) return end(now, pending, reply);
    auto envelope = sign(pending, reply.bytes);
    if (!envelope) return end(now, pending, {node::Code::invalid_argument, envelope.error().message, {}, {}});
    pending.bytes = std::move(*envelope);
    pending.endorsed = true;
    due_.emplace(later(now, delays_.submit_ns), std::move(pending));
    return;
  }
  const node::Reply reply = core_->order(pending.bytes, at(now));
  if (reply.code != node::Code::ok) return end(now, pending, reply);
  pending.ordered_after_ns = now - pending.begun_ns;
  const std::uint64_t waiter = next_waiter_++;
  core_->watch(pending.tx_id, waiter);  // never committed already: one transaction id is submitted once
  waiting_.emplace(waiter, std::move(pending));
}

TimeNs SimulatedLedger::real(TimeNs now) { return real_epoch_ns + now; }

void SimulatedLedger::order(TimeNs now, const std::string& envelope) { (void)core_->order(envelope, at(now)); }

void SimulatedLedger::cut_if_due(TimeNs now) {
  const auto due = core_->next_cut();
  if (writing_ || !due || *due > now) return;
  if (auto block = core_->cut(at(now))) writing_.emplace(later(now, delays_.write_ns), std::move(*block));
}

void SimulatedLedger::apply(TimeNs now, const node::CutBlock& block) {
  [[maybe_unused]] const Status stored = store_->append(block.bytes);
  assert(stored.ok());
  const std::vector<node::WaiterAnswer> answers = core_->apply(block);
  const auto message = std::make_shared<common::Block>();
  [[maybe_unused]] const bool whole = message->ParseFromString(block.bytes);
  assert(whole);
  for (auto& member : members_) {
    // A stream keeps its order: no block overtakes the one before.
    const TimeNs earliest = member.blocks.empty() ? 0 : member.blocks.back().first;
    member.blocks.emplace_back(std::max(earliest, delivered(now, member)), message);
  }
  for (const auto& answer : answers) {
    const auto found = waiting_.find(answer.waiter);
    fabric::Outcome outcome;
    outcome.kind = answer.status.code == 0 ? fabric::Outcome::Kind::committed : fabric::Outcome::Kind::invalidated;
    outcome.tx_id = answer.status.tx_id;
    outcome.block = answer.status.block;
    outcome.code = answer.status.code;
    const Pending& pending = found->second;
    if (committed_ && answer.status.code == 0) committed_(pending.call);
    outcome.ordered_after_ns = pending.ordered_after_ns;
    Member& member = members_[pending.client];
    member.outcomes.emplace_back(delivered(now, member), Ended{pending.id, outcome});
    waiting_.erase(found);
  }
}

void SimulatedLedger::step(TimeNs now) {
  if (writing_ && writing_->first <= now) {
    const node::CutBlock block = std::move(writing_->second);
    writing_.reset();
    apply(now, block);
  }
  while (!due_.empty() && due_.begin()->first <= now) {
    Pending pending = std::move(due_.begin()->second);
    due_.erase(due_.begin());
    advance(now, std::move(pending));
  }
  cut_if_due(now);
}

Status SimulatedLedger::commit_now(TimeNs now, Client client, const fabric::Call& call) {
  const auto proposal = propose(now, members_[client], call);
  if (!proposal) return proposal.error();
  const node::Reply endorsed = core_->endorse(proposal->signed_proposal, at(now));
  if (endorsed.code != node::Code::ok) return Error{reason_of(endorsed)};
  const auto envelope = fabric::sign_envelope(members_[client].identity, endorsed.bytes);
  if (!envelope) return envelope.error();
  const node::Reply ordered = core_->order(*envelope, at(now));
  if (ordered.code != node::Code::ok) return Error{reason_of(ordered)};
  const auto due = core_->next_cut();
  const auto block = core_->cut(at(std::max(now, due.value_or(now))));
  if (!block) return Error{"no block was cut"};
  apply(now, *block);
  if (block->transactions.front().code != 0)
    return Error{"invalid: " + std::to_string(block->transactions.front().code)};
  return done;
}

Result<std::string> SimulatedLedger::evaluate(TimeNs now, Client client, const fabric::Call& call) {
  const auto proposal = propose(now, members_[client], call);
  if (!proposal) return proposal.error();
  const node::Reply reply = core_->evaluate(proposal->signed_proposal, at(now));
  if (reply.code != node::Code::ok) return Error{reason_of(reply)};
  protos::Response response;
  if (!response.ParseFromString(reply.bytes)) return Error{"malformed protos.Response"};
  return response.payload();
}

SimulatedLedger::BlockPtr SimulatedLedger::block(std::uint64_t number) const {
  const auto message = std::make_shared<common::Block>();
  const auto bytes = store_->read(number);
  [[maybe_unused]] const bool whole = bytes.ok() && message->ParseFromString(*bytes);
  assert(whole);
  return message;
}

std::vector<SimulatedLedger::BlockPtr> SimulatedLedger::pop_blocks(TimeNs now, Client client) {
  std::vector<BlockPtr> arrived;
  auto& queue = members_[client].blocks;
  for (; !queue.empty() && queue.front().first <= now; queue.pop_front())
    arrived.push_back(std::move(queue.front().second));
  return arrived;
}

std::vector<SimulatedLedger::Ended> SimulatedLedger::pop_outcomes(TimeNs now, Client client) {
  std::vector<Ended> arrived;
  auto& queue = members_[client].outcomes;
  if (queue.empty()) return arrived;
  const auto later_ones =
      std::stable_partition(queue.begin(), queue.end(), [now](const auto& e) { return e.first <= now; });
  for (auto e = queue.begin(); e != later_ones; ++e) arrived.push_back(std::move(e->second));
  queue.erase(queue.begin(), later_ones);
  return arrived;
}

std::vector<std::string> SimulatedLedger::missing(const std::vector<std::string>& tx_ids) const {
  std::vector<std::string> missing;
  for (const std::string& tx_id : tx_ids) {
    const auto known = find(tx_id);
    if (!known || known->code != 0) missing.push_back("transaction " + tx_id);
  }
  return missing;
}

std::vector<std::string> SimulatedLedger::transition_gaps() const {
  std::map<std::pair<std::string, std::uint64_t>, std::uint64_t> newest;  // by drone and boot
  std::vector<std::string> lost;
  for (const std::string& bytes : blocks()) {
    const auto block = fabric::decode_block(bytes);
    if (!block) continue;
    for (const auto& tx : block->transactions) {
      SetCall set;
      if (tx.code != 0 || tx.event_name != contract::set || !set.ParseFromString(tx.event_payload)) continue;
      for (const Asset& asset : set.assets()) {
        const auto slash = asset.id().find("/failsafe");
        if (slash == std::string::npos) continue;
        const auto transitions = transitions_from_cdr(asset.msg_data());
        if (!transitions) {
          lost.push_back(asset.id() + " cannot be read");
          continue;
        }
        for (const Transition& t : *transitions) {
          std::uint64_t& last = newest[{asset.id().substr(0, slash), t.boot_id}];
          if (t.number > last + 1)
            lost.push_back(fmt::format("{}: transition {} after {}", asset.id(), t.number, last));
          last = std::max(last, t.number);
        }
      }
    }
  }
  return lost;
}

}  // namespace ledgerline::hil
