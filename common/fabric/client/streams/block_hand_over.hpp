#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "common/fabric/client/client.hpp"
#include "common/fabric/client/commits.hpp"
#include "common/fabric/stream/block_intake.hpp"

namespace ledgerline::fabric {

/// Fetches blocks, and notes whether one did not come: what was refused for want of it may be right.
class NotedFetch {
 public:
  explicit NotedFetch(BlockIntake::Fetch fetch) : fetch_(std::move(fetch)) {}
  Result<common::Block> operator()(std::uint64_t number) {
    auto block = fetch_(number);
    failed_ = failed_ || !block;
    return block;
  }
  bool failed() const { return failed_; }

 private:
  const BlockIntake::Fetch fetch_;
  bool failed_ = false;
};

/// Where the peer's stream and an orderer's meet: one BlockIntake, and what is handed over of it in order, whichever
/// stream delivered it first. Any thread; on_block, on_confirmed, on_unverified and on_contradiction are called under
/// its mutex, so that none of them comes beside another.
class BlockHandOver {
 public:
  BlockHandOver(BlockIntake intake, std::shared_ptr<Commits> commits, Client::StreamHandlers handlers)
      : intake_(std::move(intake)), commits_(std::move(commits)), handlers_(std::move(handlers)) {}

  using Fetch = BlockIntake::Fetch;

  // Of the peer's stream.

  /// As BlockIntake::continue_chain.
  Result<Continuation> continue_chain(const LastVerified& verified, const common::Block& newest, const Fetch& fetch);
  bool misses_definition() const;
  void define(const std::string& policy);
  /// What a connection begins with; none: with the peer's newest.
  std::optional<std::uint64_t> begin();
  /// How peer and orderers contradict each other: both streams are then read on, for on_refused alone. Empty: they do
  /// not.
  std::string contradiction() const;
  /// Its first block is here.
  void peer_connected();
  struct TakeResult {
    std::string problem{};     ///< why the stream cannot go on; empty: it can
    bool end_orderer = false;  ///< it contradicts the peer or withholds blocks
  };
  TakeResult on_peer_block(const common::Block& message, TimeNs now, const Fetch& fetch);

  // Of an orderer's stream.

  std::optional<std::uint64_t> begin_ordered();
  /// That it withheld blocks; empty: something else.
  std::string why_orderer_ended() const;
  std::string on_ordered_block(common::Block message, TimeNs now);

  // For what the readers find out themselves.

  void contradicted(const std::string& what) const;
  void report_unverified(const std::string& what) const;

 private:
  void report_contradiction(const std::string& what) const;
  void refuse(const common::Block& message) const;
  void read_on(const common::Block& message, TimeNs now);
  TakeResult take(const common::Block& message, TimeNs now, const Fetch& fetch);
  TakeResult confirm(const common::Block& message, TimeNs now);
  std::string take_ordered(TimeNs now);
  bool withholds(std::uint64_t number, TimeNs now);
  void hand_over(Block& block, const common::Block& message, TimeNs now);
  void report_unverified(const Block& block);

  mutable std::mutex mutex_;
  BlockIntake intake_;
  bool begun_ = false;
  std::map<std::uint64_t, TimeNs> ordered_at_;  ///< of what is not confirmed yet
  std::optional<TimeNs> missing_since_;         ///< the peer is ahead of the orderer's stream
  bool orderer_connected_ = false;              ///< on this connection
  std::string withheld_;                        ///< what this orderer did
  const std::shared_ptr<Commits> commits_;
  const Client::StreamHandlers handlers_;
  std::uint64_t unverified_ = 0;
  TimeNs next_word_ns_ = 0;
  TimeNs next_contradiction_ns_ = 0;  ///< it is reported once a second while it lasts
};

}  // namespace ledgerline::fabric
