#pragma once
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "common/base/result.hpp"
#include "common/fabric/blocks/checkpoint.hpp"
#include "common/fabric/client/client.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/histogram.hpp"

namespace ledgerline::fabric {

/// Where a program keeps the checkpoint of a channel, and what it found there at its start.
struct StoredCheckpoint {
  std::string path{};  ///< empty: none is kept
  std::string channel{};
  std::optional<Checkpoint> last{};

  /// An error as read_checkpoint() has it: it says what to do, and the program must not start.
  static Result<StoredCheckpoint> read(const std::string& path, const std::string& channel);
};

/// A program's subscription to the blocks of a channel: the stream of a client, which validates them and connects again
/// with back-off and jitter; the checkpoint, behind which the next start goes on, so that a chain that ends before it,
/// or has another block in its place, is refused; and what both have to say in the log. Blocks that came while the
/// program was away and are not read are logged. Any thread, but open() and close() are the owner's.
class BlockSubscription {
 public:
  struct Config {
    std::string label{};                   ///< begins each line of the log: "channel a: "
    StoredCheckpoint kept{};               ///< `last`: where it begins
    std::optional<std::uint64_t> first{};  ///< first block where there is no checkpoint; none: the next new one
    std::uint64_t max_absence_blocks = 0;  ///< LastVerified::max_absence_blocks
    bool program_stores = false;           ///< store() is called; else each block that the peer has delivered is kept,
                                           ///< for who reads everything else again at its start
  };
  explicit BlockSubscription(Config config);
  /// Ends the stream, then writes the newest checkpoint.
  ~BlockSubscription() = default;
  BlockSubscription(const BlockSubscription&) = delete;
  BlockSubscription& operator=(const BlockSubscription&) = delete;

  /// Begins. Any handler may be missing: on_unverified and on_contradiction then write to the log. They come on the
  /// client's threads.
  void open(Client& client, Client::StreamHandlers handlers);
  bool is_open() const { return stream_ != nullptr; }
  /// Ends the stream, behind its last callback; store() goes on.
  void close() { stream_.reset(); }

  bool has_checkpoint_file() const { return writer_ != nullptr; }
  /// Replaces the checkpoint that is to be written; does not wait for the disk. Nothing where none is kept.
  void store(std::uint64_t number, std::string hash, std::string records);
  /// An error says why it is not connected.
  Status connection() const;
  /// How long after the orderers the own peer delivered the same blocks, of those that were taken as they were ordered.
  Quantiles confirmed_after_ms() const;

 private:
  Config config_;
  std::unique_ptr<CheckpointWriter> writer_;  ///< null: no checkpoint is kept
  mutable std::mutex mutex_;                  ///< guards the next two
  Status connection_ = Error{"no answer yet"};
  Histogram confirmed_after_;
  std::unique_ptr<Client::Stream> stream_;  ///< ends first: its callbacks use the above
};

/// Which changes of a stream's connection are worth a line in the log. A ledger that refuses a stream ends each
/// connection just behind its begin, once a second, for as long as the cause lasts. Pure; one thread.
///
///     lost: logged ──▶ for the same reason within the rest: counted ──▶ behind it: logged with the count, rest doubles
///     connected: logged where the loss before it was, and at first
class ConnectionLog {
 public:
  /// Halved, a stream that is refused for an hour makes twice as many lines; doubled, a person waits longer for the
  /// news.
  static constexpr TimeNs first_rest_ns = 2 * ns_per_s, max_rest_ns = 120 * ns_per_s;

  /// What to say of a connection, or its end for a reason; none: nothing.
  std::optional<std::string> line(bool connected, const std::string& why, TimeNs now) {
    if (connected)
      return std::exchange(lost_is_reported_, false) ? std::optional<std::string>("connected") : std::nullopt;
    const bool again = why == why_ && now - lost_ns_ < max_rest_ns;
    lost_ns_ = now;
    if (again && now < rests_until_ns_) {
      ++unreported_;
      return std::nullopt;
    }
    rest_ns_ = again ? std::min(2 * rest_ns_, max_rest_ns) : first_rest_ns;
    rests_until_ns_ = now + rest_ns_;
    why_ = why;
    lost_is_reported_ = true;
    const std::uint64_t unreported = std::exchange(unreported_, 0);
    return again && unreported > 0 ? fmt::format("{} ({} times more since it was reported)", why, unreported) : why;
  }

 private:
  std::string why_;  ///< that was reported
  TimeNs lost_ns_ = 0, rest_ns_ = first_rest_ns, rests_until_ns_ = INT64_MIN;
  std::uint64_t unreported_ = 0;
  bool lost_is_reported_ = true;  ///< the first connection is news
};

}  // namespace ledgerline::fabric
