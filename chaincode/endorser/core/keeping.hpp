#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "common/fabric/blocks/checkpoint.hpp"

namespace ledgerline::endorser {

/// When a checkpoint may be written: once the peer has delivered its block. A checkpoint whose block only an
/// orderer has delivered waits here; the next one takes its place. Pure, one thread at a time.
class Keeping {
 public:
  /// The peer has delivered block `number`, whose header has this hash. What may be written now.
  std::optional<fabric::Checkpoint> reported(std::uint64_t number, const std::string& hash) {
    if (!reported_ || *reported_ < number) reported_ = number;
    if (!waiting_ || waiting_->number > number) return std::nullopt;
    auto due = std::exchange(waiting_, std::nullopt);
    // A difference ends the stream, and is reported elsewhere.
    if (due->number == number && due->hash != hash) return std::nullopt;
    return due;
  }
  /// What is known behind the newest block that was taken. The same.
  std::optional<fabric::Checkpoint> offer(fabric::Checkpoint newest) {
    waiting_.reset();
    if (reported_ && newest.number <= *reported_) return newest;
    waiting_ = std::move(newest);
    return std::nullopt;
  }

 private:
  std::optional<std::uint64_t> reported_;  ///< by the peer, the newest
  std::optional<fabric::Checkpoint> waiting_;
};

}  // namespace ledgerline::endorser
