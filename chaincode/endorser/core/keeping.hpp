#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "common/fabric/checkpoint/checkpoint.hpp"

namespace ledgerline::endorser {

/// When a checkpoint may be written: once the peer has told its block. One of a block that only an orderer has told yet
/// waits here; the next one takes its place. Pure, one thread at a time.
class Keeping {
 public:
  /// The peer has told block `number`, whose header has this hash. What may be written now.
  std::optional<fabric::Checkpoint> told(std::uint64_t number, const std::string& hash) {
    if (!told_ || *told_ < number) told_ = number;
    if (!waiting_ || waiting_->number > number) return std::nullopt;
    auto due = std::exchange(waiting_, std::nullopt);
    // A difference ends the stream, and is told elsewhere.
    if (due->number == number && due->hash != hash) return std::nullopt;
    return due;
  }
  /// What is known behind the newest block that was taken. The same.
  std::optional<fabric::Checkpoint> offer(fabric::Checkpoint newest) {
    waiting_.reset();
    if (told_ && newest.number <= *told_) return newest;
    waiting_ = std::move(newest);
    return std::nullopt;
  }

 private:
  std::optional<std::uint64_t> told_;  ///< by the peer, the newest
  std::optional<fabric::Checkpoint> waiting_;
};

}  // namespace ledgerline::endorser
