#include "hil/sitl/ledger/block_reader.hpp"

#include <algorithm>

#include "common/fabric/tx/envelope.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline::hil {

BlockReader::BlockReader(const SimulatedLedger& ledger, std::uint64_t seed)
    : ledger_(ledger), peer_(ledger.block(0), seed), orderer_(ledger.block(0), ~seed, test_orderer_keys()) {
  for (std::uint64_t number = 1; number < ledger.height(); ++number) peer_.add(0, ledger.block(number));
}

void BlockReader::begin(std::optional<fabric::Checkpoint> from) {
  auto intake = fabric::BlockIntake::make(
      {.where = ledger_.where(),
       .config_block = ledger_.block(0)->SerializeAsString(),
       .make_registry =
           [](const std::vector<crypto::MspRoot>& roots) {
             std::vector<std::string> names;
             for (const auto& one : roots) names.push_back(one.msp_id);
             return crypto::make_test_registry(names);
           },
       .contract_rules = {.likely_policy = [](const std::string& key) { return verification::likely_policy(key); },
                          .is_of_hot_path = [](const std::string& key) { return verification::is_of_hot_path(key); }},
       .real_time = [this] { return SimulatedLedger::real(now_); },
       .source = source_});
  orderer_connected_ = false;
  intake_ = std::move(intake).value();
  checkpoint_ = std::move(from);
  newest_verified_ = checkpoint_;
  if (!checkpoint_) intake_->start_at(peer_.height());
  reading_ = true;
}

void BlockReader::end() {
  contradictions_.clear();
  refused_.clear();
  reading_ = false;
}

bool BlockReader::connect() {
  const bool consistent = !intake_->contradiction();
  intake_->begin();
  return consistent;
}

Status BlockReader::read(TimeNs now) {
  now_ = now;
  if (!reading_) return done;
  if (auto found = find_place(now); !found || checkpoint_) return found;
  if (intake_->contradiction()) {
    read_behind_contradiction(now);
    return done;
  }
  read_ordered(now);
  while (const auto message = peer_.serve(now, *intake_->next_of_peer())) {
    if (intake_->confirms_next()) {
      if (const auto confirmed = intake_->confirm(*message); !confirmed) {
        refuse(*message);
        return disconnect_peer(confirmed.error().message);
      }
    } else {
      auto block = intake_->add(*message, [this](std::uint64_t number) { return peer_.fetch(number); });
      if (!block) {
        refuse(*message);
        return disconnect_peer(block.error().message);
      }
      add_verified(std::move(*block));
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
  const auto on = intake_->continue_chain({*checkpoint_, max_absence_blocks}, *newest,
                                          [this](std::uint64_t number) { return peer_.fetch(number); });
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
    add_verified(std::move((*ordered)->block));
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

void BlockReader::add_verified(fabric::Block block) {
  newest_verified_ = {ledger_.where().channel,
                      block.number,
                      fabric::block_header_hash(block.number, block.previous_hash, block.data_hash),
                      {}};
  verified_.push_back(std::move(block));
}

}  // namespace ledgerline::hil
