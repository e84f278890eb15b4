#pragma once
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "common/fabric/blocks/block_subscription.hpp"
#include "common/fabric/client/client.hpp"
#include "common/rt/mailbox.hpp"
#include "common/verification/control_records.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "onboard/agent/core/records.hpp"
#include "onboard/agent/shell/report.hpp"
#include "onboard/agent/shell/settings.hpp"

namespace ledgerline::agent {

/// How a submitted call ended.
struct CallEnded {
  std::uint64_t call_number = 0;
  fabric::Outcome outcome;
};
/// The block stream came up or broke.
struct StreamState {
  bool connected = false;
  std::string why;
};
/// The records to begin with, as read after the first block had come, or why they cannot be.
struct RecordsRead {
  Result<FirstRecords> records;
};
/// The roles of organisations that a record has named since, or why they cannot be read yet.
struct RolesRead {
  verification::Organisations organisations;
  Result<verification::RolesByOrganisation> roles;
};
/// The records as another organisation's peer reports them, or why it does not.
struct SecondReading {
  Result<FirstRecords> records;
};
/// The own peer has now delivered a block that was first taken from an orderer. Few are ever outstanding.
using Confirmed = fabric::Client::StreamHandlers::Confirmed;
/// A stream of blocks contradicts what is known of the channel.
struct Contradiction {
  std::string what;
};
/// A block that a stream refused: its stops count all the same.
struct RefusedBlock {
  fabric::Block block;
};
using Event = std::variant<fabric::Block, RefusedBlock, CallEnded, StreamState, fabric::Continuation, RecordsRead,
                           RolesRead, SecondReading, Contradiction, Confirmed>;

/// From the ledger client's threads to the main loop: blocks in turn; of the others only few can exist (one batch in
/// flight; a contradiction for each attempt of the stream, which backs off).
using Mailbox = ledgerline::Mailbox<Event>;

/// Reads the control records and roles of a channel's drones, from the own peer and from one of another organisation
/// (the witness), on threads of its own, which put what they read into the mailbox. All methods but read() are the
/// loop's; the mailbox must be closed before this ends.
class RecordReader {
 public:
  /// `mailbox` and `client` must outlive it. `witness`: none: nobody is asked. `recheck_ns`: between two questions to
  /// it.
  RecordReader(Mailbox& mailbox, std::string label, std::vector<std::string> drones, fabric::Client& client,
               std::unique_ptr<fabric::Client> witness, TimeNs recheck_ns);

  /// Blocks were not read, so that nothing connects what was verified with what the peer reports now: the witness,
  /// where there is one, must report the same records once.
  void require_witness();
  /// What the own peer reports, confirmed by the witness where that is required. Waits for the answers. Any thread.
  Result<FirstRecords> read();
  /// The same, until it succeeds, as RecordsRead.
  void read_in_background();
  /// The roles of these organisations and of those that could not be read before, as RolesRead; one reading at a time.
  void read_roles(verification::Organisations organisations);
  void on_roles(const RolesRead& read);
  /// Asks the witness now and each recheck_ns, as SecondReading; sooner after set_early_recheck(true).
  void watch_witness();
  void set_early_recheck(bool soon) { recheck_early_ = soon; }

 private:
  Result<FirstRecords> read_from(const verification::Evaluate& evaluate) const;
  Status confirm(const FirstRecords& records);
  void wait(const std::stop_token& stop, bool may_be_shortened) const;

  Mailbox& mailbox_;
  const std::string label_;
  const std::vector<std::string> drones_;
  fabric::Client& client_;
  const std::unique_ptr<fabric::Client> witness_;
  const TimeNs recheck_ns_;
  std::atomic<bool> unconfirmed_{false};  ///< the witness is required
  std::atomic<bool> recheck_early_{false};
  verification::Organisations unread_;       ///< whose roles are to be read, once no such reading is in progress
  std::optional<std::jthread> role_reader_;  ///< one at a time
  std::jthread control_reader_, witness_reader_;
};

/// For the calling thread: a block's way to link is the stream's thread, then the main loop. Priority 0: as it is.
void raise_priority(int priority, const char* thread);

/// Follows the ledger for the core of one channel: gives it the first records, by the checkpoint or as they are read,
/// then each block in its order; compares the records with another organisation's; keeps the checkpoint. The client's
/// threads hand over through the mailbox. All methods but the constructor's and reach() are
/// the loop's.
class LedgerFollower {
 public:
  /// What it refers to must outlive it.
  struct Parts {
    const Settings& settings;
    std::string label;  ///< begins what is said
    bool several;       ///< there are further channels: one whose records cannot be read ends nothing
    AgentCore& core;
    AgentOutputs& out;
    Mailbox& mailbox;
    fabric::Client& client;
    std::unique_ptr<fabric::Client> witness;
    fabric::StoredCheckpoint kept;
  };
  explicit LedgerFollower(Parts parts);

  /// Begins the block stream; does not wait.
  void start();
  /// Waits for the block stream and the control records, each for a bounded time, with a message that names the cure.
  Status reach(const std::atomic<bool>& quit, AgentLog& log);
  /// Anything but a CallEnded. An error ends the agent.
  Status handle(Event& event);
  /// The newest block that the own peer has delivered too, with the records behind it.
  void store_checkpoint();
  void count(ShellCounters& counters) const;

 private:
  Status wait_for_block_stream(const std::atomic<bool>& quit, AgentLog& log);
  Status handle_early_events(AgentLog& log);
  void on_continued(const fabric::Continuation& how);
  Status on_block(const fabric::Block& block);
  Status on_records(const RecordsRead& read);
  void on_second_reading(const SecondReading& reading);
  void set_records(const FirstRecords& records);
  void report_by_flag();
  void report_left_out();

  const Settings& settings_;
  const std::string label_;
  const bool several_;
  AgentCore& core_;
  AgentOutputs& out_;
  Mailbox& mailbox_;
  fabric::Client& client_;
  verification::ControlStart control_start_;
  std::uint64_t checkpoint_block_ = 0;
  std::optional<FirstRecords> kept_records_;  ///< of the checkpoint, where it has one of each drone
  std::uint64_t catch_up_to_ = 0;             ///< height that the chain had at the start
  std::uint64_t blocks_not_read_ = 0;         ///< between the checkpoint and the start, after a long absence
  StreamState stream_;                        ///< as taken last
  std::optional<Confirmed> confirmed_;        ///< the newest block that the own peer has delivered; none: it is kept
  SecondOpinion second_opinion_;
  std::string witness_problem_;        ///< as reported last
  std::size_t left_out_reported_ = 0;  ///< organisations whose roles are left out, as reported last
  fabric::BlockSubscription blocks_;   ///< these two end first: their threads use the mailbox and the client
  RecordReader records_;
};

}  // namespace ledgerline::agent
