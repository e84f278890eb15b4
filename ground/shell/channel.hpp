#pragma once
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "common/fabric/blocks/block_subscription.hpp"
#include "common/fabric/client/client.hpp"
#include "common/verification/control_records.hpp"
#include "ground/core/flight.hpp"

namespace ledgerline::ground {

/// One channel of a ground: the flight of its drones, and its way to the ledger. What comes of the ledger is put on the
/// client's threads; all methods are the core's thread's.
class Channel {
 public:
  struct Parts {
    FlightConfig flight;
    std::unique_ptr<fabric::Client> client;  ///< for commands and blocks
    std::unique_ptr<fabric::Client> urgent;  ///< for what must not wait behind commands
    fabric::StoredCheckpoint kept;           ///< as the last ground left it
  };

  struct Ended {
    std::uint64_t id;
    std::string function;  ///< that was called
    fabric::Outcome outcome;
  };
  /// The control records, as read after the first block had come, or why they cannot be.
  struct ControlsRead {
    Result<std::vector<Control>> controls;
  };
  using Update = std::variant<fabric::Block, Ended, ControlsRead>;
  /// Any thread, but one that may wait where a block comes.
  using Put = std::function<void(Update)>;

  /// `label` begins what is said; empty: there is one channel.
  Channel(Parts parts, std::string label, Put put);

  FlightCore& core() { return core_; }
  const FlightCore& core() const { return core_; }
  const std::string& label() const { return label_; }
  fabric::Client& urgent() { return *urgent_; }
  Quantiles confirmed_after_ms() const { return blocks_.confirmed_after_ms(); }

  /// Subscribes to the blocks that come from now on.
  void open_stream();
  /// Whether they come; an error says why not. Any thread.
  Status connection() const { return blocks_.connection(); }
  /// Reads the drones' control records; behind the stream's start.
  Status read_controls();
  /// True: pass the block to the core. False: it waits here, and on_controls() returns it.
  Result<bool> on_block(const fabric::Block& block);
  /// The blocks that waited for the records: they come next.
  Result<std::vector<fabric::Block>> on_controls(const ControlsRead& read);
  /// The outcome is put.
  void submit(Submission submission);
  /// Ends all that calls `put`; calls in flight are put as unavailable before it returns. Call it before destroying
  /// what `put` uses.
  void close();
  /// What becomes of a submission that somebody else signs.
  std::function<void(fabric::Outcome)> on_end(const Submission& submission) const;

 private:
  Status set_controls(const std::vector<Control>& controls);

  FlightCore core_;
  const std::vector<std::string> names_;  ///< of the drones
  const std::string label_;
  const Put put_;
  verification::ControlStart control_start_;

  std::unique_ptr<fabric::Client> client_, urgent_;
  fabric::BlockSubscription blocks_;
  std::jthread control_reader_;
};

}  // namespace ledgerline::ground
