#include "hil/sitl/ledger/block_reader.hpp"

#include <algorithm>
#include <cassert>

#include "common/fabric/tx/envelope.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline::hil {

namespace {

/// Of a reader of which `now` is the time.
fabric::BlockIntake make_intake(const SimulatedLedger& ledger, fabric::BlockSource source, const TimeNs& now) {
  auto intake = fabric::BlockIntake::make(
      {.where = ledger.where(),
       .config_block = ledger.block(0)->SerializeAsString(),
       .make_registry =
           [](const std::vector<crypto::MspRoot>& roots) {
             std::vector<std::string> names;
             for (const auto& one : roots) names.push_back(one.msp_id);
             return crypto::make_test_registry(names);
           },
       .contract_rules = {.likely_policy = [](const std::string& key) { return verification::likely_policy(key); },
                          .is_of_hot_path = [](const std::string& key) { return verification::is_of_hot_path(key); }},
       .real_time = [&now] { return SimulatedLedger::real(now); },
       .source = source});
  return std::move(intake).value();
}

}  // namespace

CommonIntake::CommonIntake(const SimulatedLedger& ledger, std::uint64_t first)
    : ledger_(ledger), intake_(make_intake(ledger, fabric::BlockSource::peer, now_)) {
  intake_.start_at(first);
}

VerifiedBlock CommonIntake::verify(TimeNs now, const SimulatedLedger::BlockPtr& block) {
  if (block->header().number() == intake_.next()) {
    now_ = now;
    auto verified =
        intake_.add(*block, [this](std::uint64_t number) -> Result<common::Block> { return *ledger_.block(number); });
    if (!verified) return nullptr;
    newest_.emplace_back(block, std::make_shared<const fabric::Block>(std::move(*verified)));
    if (newest_.size() > max_kept) newest_.pop_front();
    return newest_.back().second;
  }
  const auto known = std::ranges::find(
      newest_, block, [](const auto& one) -> const auto& { return one.first; });
  return known == newest_.end() ? nullptr : known->second;
}

BlockReader::BlockReader(SimulatedLedger& ledger, std::uint64_t seed)
    : ledger_(ledger), peer_(ledger.block(0), seed), orderer_(ledger.block(0), ~seed, test_orderer_keys()) {
  for (std::uint64_t number = 1; number < ledger.height(); ++number) peer_.add(0, ledger.block(number));
}

void BlockReader::begin(std::optional<fabric::Checkpoint> from) {
  orderer_connected_ = false;
  checkpoint_ = began_behind_ = std::move(from);
  newest_verified_.reset();
  intake_.reset();
  common_.reset();
  read_ns_.clear();
  first_ = peer_.height();
  if (checkpoint_ || source_ != fabric::BlockSource::peer) {
    intake_.emplace(make_intake(ledger_, source_, now_));
    if (!checkpoint_) intake_->start_at(first_);
  } else {
    auto& common = ledger_.common_intakes()[first_];
    common_ = common.lock();
    if (!common_) common = common_ = std::make_shared<CommonIntake>(ledger_, first_);
  }
  reading_ = true;
}

/// What the common intake has made of its blocks so far an own one makes again.
void BlockReader::go_alone() {
  if (!common_) return;
  common_.reset();
  intake_.emplace(make_intake(ledger_, source_, now_));
  intake_->start_at(first_);
  const TimeNs now = now_;
  for (std::size_t i = 0; i < read_ns_.size(); ++i) {
    now_ = read_ns_[i];
    [[maybe_unused]] const auto again = intake_->add(*peer_.at(first_ + i), fetch());
    assert(again.ok());
  }
  now_ = now;
}

std::uint64_t BlockReader::next_of_peer() const {
  return common_ ? first_ + read_ns_.size() : *intake_->next_of_peer();
}

fabric::BlockIntake::Fetch BlockReader::fetch() const {
  return [this](std::uint64_t number) { return peer_.fetch(number); };
}

std::optional<fabric::Checkpoint> BlockReader::checkpoint() const {
  if (!newest_verified_) return began_behind_;
  const fabric::Block& block = *newest_verified_;
  return fabric::Checkpoint{ledger_.where().channel,
                            block.number,
                            fabric::block_header_hash(block.number, block.previous_hash, block.data_hash),
                            {}};
}

void BlockReader::end() {
  contradictions_.clear();
  refused_.clear();
  reading_ = false;
}

bool BlockReader::connect() {
  go_alone();
  const bool consistent = !intake_->contradiction();
  intake_->begin();
  return consistent;
}

Status BlockReader::read(TimeNs now) {
  now_ = now;
  if (!reading_) return done;
  if (auto found = find_place(now); !found || checkpoint_) return found;
  if (intake_ && intake_->contradiction()) {
    read_behind_contradiction(now);
    return done;
  }
  read_ordered(now);
  while (const auto message = peer_.serve(now, next_of_peer())) {
    if (common_) {
      const bool honest = message == peer_.at(next_of_peer());
      if (auto block = honest ? common_->verify(now, message) : nullptr) {
        read_ns_.push_back(now);
        add_verified(std::move(block));
        continue;
      }
      go_alone();
    }
    if (intake_->confirms_next()) {
      if (const auto confirmed = intake_->confirm(*message); !confirmed) {
        refuse(*message);
        return disconnect_peer(confirmed.error().message);
      }
    } else {
      auto block = intake_->add(*message, fetch());
      if (!block) {
        refuse(*message);
        return disconnect_peer(block.error().message);
      }
      add_verified(std::make_shared<const fabric::Block>(std::move(*block)));
    }
    (void)pop_ordered(now);
  }
  return done;
}

/// Where the checkpoint remains, the peer does not say yet what its newest block is.
Status BlockReader::find_place(TimeNs now) {
  if (!checkpoint_) return done;
  const auto newest = peer_.newest(now);
  if (!newest) return done;
  const auto on = intake_->continue_chain({*checkpoint_, max_absence_blocks}, *newest, fetch());
  if (!on) return disconnect_peer(on.error().message);
  checkpoint_.reset();
  return done;
}

Status BlockReader::disconnect_peer(std::string why) {
  contradictions_.push_back(why);
  return Error{std::move(why)};
}

// As fabric::BlockHandOver: behind a contradiction both streams go on for what counts by its signature alone.
void BlockReader::read_behind_contradiction(TimeNs now) {
  const std::uint64_t first = *intake_->next_of_peer();
  next_refused_ = std::max(next_refused_, first);
  next_ordered_refused_ = std::max(next_ordered_refused_, first);
  std::size_t sent = 0;
  const auto read = [&](ServingPeer& from, std::uint64_t& next) {
    for (; const auto message = from.serve(now, next); ++next, ++sent) refuse(*message);
  };
  read(peer_, next_refused_);
  if (reads_ordered()) read(orderer_, next_ordered_refused_);
  if (sent == 0 || now < next_contradiction_ns_) return;
  next_contradiction_ns_ = now + ns_per_s;
  contradictions_.push_back(*intake_->contradiction());
}

void BlockReader::read_ordered(TimeNs now) {
  if (!reads_ordered()) return;
  if (!orderer_connected_ && (now < orderer_at_ns_ || !intake_->begin_ordered())) return;
  orderer_connected_ = true;
  while (orderer_connected_) {
    const auto message = orderer_.serve(now, *intake_->next_ordered());
    if (!message) return;
    if (const Status added = intake_->add_ordered(*message); !added) {
      refuse(*message);
      return disconnect_orderer(now, added.error().message);
    }
    if (!pop_ordered(now)) return;
  }
}

/// False: what the orderer has delivered is refused.
bool BlockReader::pop_ordered(TimeNs now) {
  while (true) {
    auto ordered = intake_->pop_ordered();
    if (!ordered) {
      disconnect_orderer(now, ordered.error().message);
      return false;
    }
    if (!*ordered) return true;
    add_verified(std::make_shared<const fabric::Block>(std::move((*ordered)->block)));
  }
}

void BlockReader::disconnect_orderer(TimeNs now, std::string why) {
  contradictions_.push_back(std::move(why));
  orderer_connected_ = false;
  orderer_at_ns_ = now + reconnect_ns;
}

void BlockReader::refuse(const common::Block& message) {
  if (auto block = fabric::decode_block(message)) refused_.push_back(std::move(*block));
}

void BlockReader::add_verified(VerifiedBlock block) {
  newest_verified_ = block;
  verified_.push_back(std::move(block));
}

}  // namespace ledgerline::hil
