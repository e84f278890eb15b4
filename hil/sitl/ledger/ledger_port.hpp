#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/random.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "hil/netem/distribution.hpp"
#include "hil/sitl/ledger/block_reader.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"

namespace ledgerline::hil {

/// Tampering with the blocks that a program is given, applied after its block stream's checks, as if the stream checked
/// nothing.
enum class Tampering : std::uint8_t {
  none,
  chain,        ///< blocks that name another previous hash, with all their transactions
  hash,         ///< before each block an empty one of its number, which names another previous hash
  number,       ///< before each block an empty one of the next number
  signature,    ///< transactions whose creator did not sign them
  endorsement,  ///< nobody endorsed them
  outsider,     ///< a peer of another organisation alone did
  member,       ///< a member of our organisation did, who is no peer
  channel,      ///< of another channel
  contract,     ///< of another contract
  flag,         ///< flagged invalid
  stops,        ///< stops alone flagged invalid
};

/// What is wrong with the operator's own commands, signed all the same.
enum class Slip : std::uint8_t {
  none,
  boot,   ///< they answer another start of link
  stamp,  ///< they answer a state that never was
  speed,  ///< 9 m/s ahead
  late,   ///< setpoints for a moment behind the horizon
  twice,  ///< each is submitted twice
};

/// The calls of one process that have not ended. Each ends once.
class LedgerCalls {
 public:
  explicit LedgerCalls(TimeNs timeout_ns) : timeout_ns_(timeout_ns) {}

  /// The number by which the ledger knows it. A copy that nobody waits for has one, too.
  std::uint64_t add(TimeNs now, std::uint64_t id);
  std::uint64_t add_copy() { return next_++; }
  /// By its number; one that has ended, or is of a process that is gone, is passed over.
  void end(const SimulatedLedger::Ended& ended);
  /// Ends those whose deadline has come as unavailable.
  void fail(const std::string& why, TimeNs now);
  void forget();

  std::vector<SimulatedLedger::Ended> pop_ended() { return std::exchange(ended_, {}); }
  std::size_t size() const { return open_.size(); }
  const std::vector<std::string>& committed() const { return committed_; }

 private:
  struct Call {
    std::uint64_t id = 0;  ///< the caller's
    TimeNs deadline_ns = 0;
  };
  TimeNs timeout_ns_;
  std::uint64_t next_ = 1;
  std::map<std::uint64_t, Call> open_;  ///< by number
  std::vector<SimulatedLedger::Ended> ended_;
  std::vector<std::string> committed_;  ///< transactions
};

/// The verified blocks on their last way to a process, with what may be wrong with them there.
class BlockDelivery {
 public:
  void set_tampering(Tampering tampering) { tampering_ = tampering; }
  /// Shows the newest blocks repeatedly; none may be added meanwhile.
  void stale(bool stale) { stale_ = stale; }
  bool stale() const { return stale_; }

  void add(const VerifiedBlock& block);
  void step(TimeNs now);
  std::vector<VerifiedBlock> pop() { return std::exchange(delivered_, {}); }
  void forget() { delivered_.clear(); }

 private:
  Tampering tampering_ = Tampering::none;
  bool stale_ = false;
  TimeNs next_stale_ns_ = 0;
  std::deque<VerifiedBlock> newest_;
  std::vector<VerifiedBlock> delivered_;
};

/// One process' connection to the simulated ledger, with what may be wrong with it. It keeps its order, as TCP does,
/// and behaves as fabric::Client: every call ends once, as unavailable when no answer came within the deadline; blocks
/// come through a BlockReader, also behind a cut; a peer that contradicts itself is left and asked again.
/// Deterministic for a seed; one thread.
class LedgerPort {
 public:
  static constexpr TimeNs deadline_ns = 1 * ns_per_s;  ///< as agent and ground, of a ledger that is not far
  static constexpr TimeNs reconnect_ns = BlockReader::reconnect_ns;

  /// `way` and `share`: of the ledger's added delay (SimulatedLedger::add_client()).
  LedgerPort(SimulatedLedger& ledger, const crypto::IdentityName& name, std::uint64_t seed,
             OneWayDelay::Direction way = OneWayDelay::Direction::there, double share = 0.5,
             TimeNs timeout_ns = deadline_ns);

  void submit(TimeNs now, std::uint64_t id, fabric::Call call);
  /// Moves what is due, both ways. After the ledger's own step.
  void step(TimeNs now);
  std::vector<VerifiedBlock> pop_blocks() { return delivery_.pop(); }
  std::vector<fabric::Block> pop_refused() { return reader_.pop_refused(); }
  std::vector<SimulatedLedger::Ended> pop_outcomes() { return calls_.pop_ended(); }
  /// Whether the block stream has come or gone since the last call.
  std::optional<bool> pop_connection_change() { return std::exchange(connection_, std::nullopt); }
  Result<std::string> evaluate(TimeNs now, const fabric::Call& call) { return ledger_.evaluate(now, client_, call); }
  bool reachable() const { return !cut_ && !to_.stalled && !from_.stalled; }

  /// The process died: nobody waits for what is in flight, and nobody receives blocks.
  void forget();
  /// A process begins: it hears the next new block first, or goes on behind the checkpoint.
  void begin(std::optional<fabric::Checkpoint> from = std::nullopt);
  /// Whose blocks a process takes that begins from now on. With an orderer's stream the peer is behind it by up to
  /// max_peer_lag_ns.
  void set_block_source(fabric::BlockSource source) { reader_.set_block_source(source); }
  static constexpr TimeNs max_peer_lag_ns = 6 * ns_per_ms;
  std::optional<fabric::Checkpoint> checkpoint() const { return reader_.checkpoint(); }
  std::vector<std::string> pop_contradictions() { return reader_.pop_contradictions(); }

  // Faults.
  void delay_to(std::optional<Distribution> delay) { to_.delay = std::move(delay); }
  void delay_from(std::optional<Distribution> delay) { from_.delay = std::move(delay); }
  const std::optional<Distribution>& delay_to() const { return to_.delay; }
  const std::optional<Distribution>& delay_from() const { return from_.delay; }
  void stall_to(bool stalled) { to_.stalled = stalled; }
  void stall_from(bool stalled) { from_.stalled = stalled; }
  /// The connection breaks and cannot be restored: what is in flight ends as unavailable, so does what is submitted.
  void cut(TimeNs now, bool away);
  /// The peer restarts: as a cut that is over at once, where none lasts.
  void restart(TimeNs now) {
    if (cut_) return;
    cut(now, true);
    cut(now, false);
  }
  /// The peer shows its last blocks over and over, and no new one.
  void stale(bool stale) { delivery_.stale(stale); }
  void set_tampering(Tampering tampering) { delivery_.set_tampering(tampering); }
  /// What the peer serves in place of the ledger's blocks.
  void serve(PeerTampering tampering) { reader_.serve(tampering); }
  /// What an orderer does, which has an orderer's key.
  void order(PeerTampering tampering) { reader_.order(tampering); }
  void slip(Slip slip) { slip_ = slip; }

  std::size_t in_flight() const { return calls_.size(); }
  /// The transactions that were reported to this process as committed.
  const std::vector<std::string>& acknowledged() const { return calls_.committed(); }

 private:
  using BlockPtr = SimulatedLedger::BlockPtr;
  /// Of the connection. What goes this way keeps its order, whatever each piece is delayed by.
  struct Direction {
    explicit Direction(std::uint64_t seed) : draws(seed) {}
    TimeNs arrival_ns(TimeNs now);

    Draws draws;
    std::optional<Distribution> delay{};
    bool stalled = false;
    TimeNs last_ns = 0;
  };
  struct Request {
    TimeNs due_ns = 0;
    std::uint64_t number = 0;
    fabric::Call call;
  };
  void send(TimeNs now, std::uint64_t number, fabric::Call call);
  void receive_from_ledger(TimeNs now, bool connected);
  void deliver(TimeNs now);

  SimulatedLedger& ledger_;
  SimulatedLedger::Client client_;
  LedgerCalls calls_;
  BlockReader reader_;
  BlockDelivery delivery_;
  Direction to_, from_;
  std::deque<Request> requests_;                                    ///< on their way to the ledger
  std::deque<std::pair<TimeNs, SimulatedLedger::Ended>> outcomes_;  ///< on their way back
  std::deque<std::pair<TimeNs, BlockPtr>> blocks_, ordered_;        ///< on their way to the reader's peer and orderer
  Random peer_lags_;                                                ///< behind the orderer
  TimeNs last_peer_ns_ = 0;
  Slip slip_ = Slip::none;
  bool cut_ = false;
  TimeNs connect_at_ns_ = 0;  ///< 0: it is connected, or cut
  std::optional<bool> connection_;
};

}  // namespace ledgerline::hil
