#include "common/fabric/blocks/block_hand_over.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/text.hpp"
#include "common/fabric/tx/envelope.hpp"

namespace ledgerline::fabric {
namespace {

constexpr TimeNs unverified_period_ns = 60 * ns_per_s;    // a peer may send thousands; a log must not fill a disk
constexpr TimeNs contradiction_period_ns = 1 * ns_per_s;  // below what agent's integrity hold lasts
constexpr TimeNs max_connecting_ns = 10 * ns_per_s;
constexpr TimeNs max_missing_ns = 1 * ns_per_s;  // far beyond what an orderer's thread may be behind on a busy machine

}  // namespace

void BlockHandOver::peer_connected() {
  const std::lock_guard lock(mutex_);
  begun_ = true;
  intake_.begin();
}

Result<BlockHandOver::OrdererStream> BlockHandOver::on_peer_block(const common::Block& message, TimeNs now,
                                                                  const Fetch& fetch) {
  const std::lock_guard lock(mutex_);
  if (intake_.contradiction()) {
    read_on(message, now);
    return OrdererStream::goes_on;
  }
  auto result = intake_.confirms_next() ? confirm(message, now) : add(message, now, fetch);
  if (!result) refuse(message);
  return result;
}

Status BlockHandOver::consistent() const {
  const std::lock_guard lock(mutex_);
  return intake_.contradiction() ? Status(Error{*intake_.contradiction()}) : done;
}

void BlockHandOver::read_on(const common::Block& message, TimeNs now) {
  if (now >= next_contradiction_ns_) {
    next_contradiction_ns_ = now + contradiction_period_ns;
    report_contradiction(*intake_.contradiction());
  }
  refuse(message);
}

void BlockHandOver::refuse(const common::Block& message) const {
  if (!handlers_.on_refused) return;
  const auto block = decode_block(message);
  if (block) handlers_.on_refused(*block);
}

Result<BlockHandOver::OrdererStream> BlockHandOver::add(const common::Block& message, TimeNs now, const Fetch& fetch) {
  // "From the next new one on": the newest block that the peer sends first only says where that is.
  const bool wanted = intake_.next().has_value();
  bool fetch_failed = false;
  auto block = intake_.add(message, watched(fetch, fetch_failed));
  if (!block) {
    if (!fetch_failed) report_contradiction(block.error().message);
    return block.error();
  }
  if (wanted) {
    hand_over(*block, message, now);
  } else {
    block->received_ns = now;
    commits_->block(*block);
  }
  const auto forged = intake_.pop_orderer_problem();
  if (forged) report_contradiction(*forged);
  const bool ends = forged || !hand_over_ordered(now) || check_withheld(block->number, now);
  return ends ? OrdererStream::ends : OrdererStream::goes_on;
}

Result<BlockHandOver::OrdererStream> BlockHandOver::confirm(const common::Block& message, TimeNs now) {
  const auto confirmed = intake_.confirm(message);
  if (!confirmed) {
    report_contradiction(confirmed.error().message);
    return confirmed.error();
  }
  if (*confirmed > 0 && handlers_.on_unverified)
    handlers_.on_unverified(fmt::format(
        "block {}: {} of its transactions, taken as they were ordered, are invalid: their ids were used before; "
        "their creators' clocks are wrong, or they did it on purpose",
        message.header().number(), *confirmed));
  const TimeNs ordered = ordered_at_.extract(message.header().number()).mapped();
  // `now` is from before this thread waited for the mutex, maybe for the orderer's.
  if (handlers_.on_confirmed)
    handlers_.on_confirmed({message.header().number(), header_hash(message.header()), ordered, std::max(ordered, now)});
  // Where the bound was reached, more may be taken now.
  return hand_over_ordered(now) ? OrdererStream::goes_on : OrdererStream::ends;
}

bool BlockHandOver::check_withheld(std::uint64_t number, TimeNs now) {
  const auto next = intake_.next_ordered();
  if (!next || *next > number) {
    missing_since_.reset();
    return false;
  }
  if (!missing_since_) missing_since_ = now;
  if (now - *missing_since_ < (orderer_connected_ ? max_missing_ns : max_connecting_ns)) return false;
  missing_since_.reset();
  withheld_ = fmt::format("it withholds block {}: the peer is at block {}", *next, number);
  return true;
}

std::optional<std::uint64_t> BlockHandOver::begin_ordered() {
  const std::lock_guard lock(mutex_);
  missing_since_.reset();
  withheld_.reset();
  orderer_connected_ = false;
  return begun_ ? intake_.begin_ordered() : std::nullopt;
}

std::optional<std::string> BlockHandOver::withheld() const {
  const std::lock_guard lock(mutex_);
  return withheld_;
}

Status BlockHandOver::on_ordered_block(common::Block message, TimeNs now) {
  const std::lock_guard lock(mutex_);
  missing_since_.reset();
  orderer_connected_ = true;
  if (intake_.contradiction()) {
    read_on(message, now);
    return done;
  }
  if (const Status added = intake_.add_ordered(message); !added) {
    report_contradiction(added.error().message);
    refuse(message);
    return added;
  }
  Status handed_over = hand_over_ordered(now);
  if (!handed_over) refuse(message);
  return handed_over;
}

Status BlockHandOver::hand_over_ordered(TimeNs now) {
  while (true) {
    auto ordered = intake_.pop_ordered();
    if (!ordered) {
      report_contradiction(ordered.error().message);
      return ordered.error();
    }
    if (!*ordered) return done;
    ordered_at_[(*ordered)->block.number] = now;
    hand_over((*ordered)->block, (*ordered)->message, now);
  }
}

void BlockHandOver::hand_over(Block& block, const common::Block& message, TimeNs now) {
  block.received_ns = now;
  report_unverified(block);
  if (handlers_.on_block) handlers_.on_block(block, message.SerializeAsString());
  commits_->block(block);
}

void BlockHandOver::report_contradiction(const std::string& what) const {
  if (handlers_.on_contradiction) handlers_.on_contradiction(what);
}

void BlockHandOver::contradicted(const std::string& what) const {
  const std::lock_guard lock(mutex_);
  report_contradiction(what);
}

void BlockHandOver::report_unverified(const std::string& what) const {
  const std::lock_guard lock(mutex_);
  if (handlers_.on_unverified) handlers_.on_unverified(what);
}

void BlockHandOver::report_unverified(const Block& block) {
  for (const Transaction& transaction : block.transactions) {
    if (transaction.problem.empty()) continue;
    ++unverified_;
    if (!handlers_.on_unverified || (unverified_ > 1 && block.received_ns < next_unverified_ns_)) continue;
    next_unverified_ns_ = block.received_ns + unverified_period_ns;
    handlers_.on_unverified(fmt::format("block {}: transaction {}: its flag is not trusted: {}; left out ({} so far)",
                                        block.number, printable(transaction.tx_id), transaction.problem, unverified_));
  }
}

}  // namespace ledgerline::fabric
