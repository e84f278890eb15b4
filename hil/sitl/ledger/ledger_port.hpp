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
#include "common/fabric/stream/block_intake.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "hil/netem/distribution.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"
#include "hil/sitl/peer/serving_peer.hpp"

namespace ledgerline::hil {

/// What is wrong with the blocks that a program is given, behind all that its stream of blocks checks: as from one that
/// checks nothing.
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
std::optional<Tampering> lie_from(std::string_view word);
std::string lies();  ///< all of them, for errors

/// What is wrong with the operator's own commands, signed all the same.
enum class Slip : std::uint8_t {
  none,
  boot,   ///< they answer another start of link
  stamp,  ///< they answer a state that never was
  speed,  ///< 9 m/s ahead
  late,   ///< setpoints for a moment behind the horizon
  twice,  ///< each is submitted twice
};
std::optional<Slip> slip_from(std::string_view word);
std::string slips();

/// One process' connection to the simulated ledger, with what may be wrong with it. It keeps its order, as TCP does,
/// and behaves as fabric::Client: every call ends once, as unavailable when no answer came within the deadline; blocks
/// come through a BlockIntake, with the channel's first block as the trust anchor, without gap or duplicate, also
/// behind a cut; a peer that contradicts itself is left and asked again. Deterministic for a seed; one thread.
class LedgerPort {
 public:
  static constexpr TimeNs deadline_ns = 1 * ns_per_s;  ///< as agent and ground, of a ledger that is not far
  static constexpr TimeNs reconnect_ns = 150 * ns_per_ms;
  static constexpr std::uint64_t max_absence_blocks = 1'000;  ///< as agent's

  /// `way` and `share`: of the ledger's added delay (SimulatedLedger::add_client()).
  LedgerPort(SimulatedLedger& ledger, const crypto::IdentityName& name, std::uint64_t seed,
             WayDelay::Way way = WayDelay::Way::there, double share = 0.5, TimeNs timeout_ns = deadline_ns);

  void submit(TimeNs now, std::uint64_t id, fabric::Call call);
  /// Moves what is due, both ways. After the ledger's own step.
  void step(TimeNs now);
  std::vector<fabric::Block> take_blocks();
  /// That were refused: of either stream, by nobody's flag.
  std::vector<fabric::Block> take_refused() { return std::exchange(refused_blocks_, {}); }
  std::vector<SimulatedLedger::Ended> take_outcomes();
  /// Whether the block stream has come or gone since the last call.
  std::optional<bool> take_connection();
  Result<std::string> evaluate(TimeNs now, const fabric::Call& call) { return ledger_.evaluate(now, client_, call); }
  bool reachable() const { return !cut_ && !stalled_to_ && !stalled_from_; }

  /// The process died: nobody waits for what is in flight, and nobody receives blocks.
  void forget();
  /// A process begins: it hears the next new block first, or goes on behind the checkpoint.
  void begin(std::optional<fabric::Checkpoint> from = std::nullopt);
  /// Whose blocks a process takes that begins from now on. With an orderer's stream the peer is behind it by up to
  /// max_peer_lag_ns.
  void take_blocks_of(fabric::BlockSource source) { source_ = source; }
  static constexpr TimeNs max_peer_lag_ns = 6 * ns_per_ms;
  /// The newest block that was verified; none: none was yet.
  std::optional<fabric::Checkpoint> checkpoint() const;
  /// Why the peer was left since the last call, in words.
  std::vector<std::string> take_contradictions() { return std::exchange(contradictions_, {}); }

  // Faults.
  void delay_to(std::optional<Distribution> delay) { delay_to_ = std::move(delay); }
  void delay_from(std::optional<Distribution> delay) { delay_from_ = std::move(delay); }
  const std::optional<Distribution>& delay_to() const { return delay_to_; }
  const std::optional<Distribution>& delay_from() const { return delay_from_; }
  void stall_to(bool stalled) { stalled_to_ = stalled; }
  void stall_from(bool stalled) { stalled_from_ = stalled; }
  /// The connection breaks and cannot be restored: what is in flight ends as unavailable, so does what is submitted.
  void cut(TimeNs now, bool away);
  /// The peer restarts: as a cut that is over at once, where none lasts.
  void restart(TimeNs now) {
    if (cut_) return;
    cut(now, true);
    cut(now, false);
  }
  /// The peer shows its last blocks over and over, and no new one.
  void stale(bool stale) { stale_ = stale; }
  void lie(Tampering lie) { lie_ = lie; }
  /// What the peer serves in place of the ledger's blocks.
  void serve(PeerTampering lie) { peer_.lie(lie); }
  /// What an orderer does, which has an orderer's key.
  void order(PeerTampering lie) { orderer_.lie(lie); }
  void slip(Slip slip) { slip_ = slip; }

  struct Counts {
    std::uint64_t submitted = 0, committed = 0, invalidated = 0, refused = 0, unavailable = 0;
    std::uint64_t blocks = 0, stale_blocks = 0;
    std::uint64_t ordered_blocks = 0;  ///< of the former, that were taken as they were ordered
  };
  const Counts& counts() const { return counts_; }
  std::size_t under_way() const { return open_.size(); }
  /// The transactions that were reported to this process as committed.
  const std::vector<std::string>& acknowledged() const { return acknowledged_; }

 private:
  struct Waiting {
    TimeNs due_ns = 0;
    std::uint64_t id = 0;
    fabric::Call call;
  };
  void end(const SimulatedLedger::Ended& ended);
  void send(TimeNs now, std::uint64_t number, fabric::Call call);
  void read_blocks(TimeNs now);
  void read_ordered(TimeNs now);
  bool take_ordered(TimeNs now);
  void refuse(const common::Block& message);
  void read_on(TimeNs now);
  void leave_orderer(TimeNs now, const std::string& why);
  void hand_over(fabric::Block block);
  bool find_place(TimeNs now);
  void leave_peer(TimeNs now, const std::string& why);
  void arrive(fabric::Block block);
  static TimeNs in_order(TimeNs due_ns, TimeNs& last_ns);

  SimulatedLedger& ledger_;
  SimulatedLedger::Client client_;
  TimeNs timeout_ns_;
  Draws draws_to_, draws_from_;
  std::optional<Distribution> delay_to_, delay_from_;
  Tampering lie_ = Tampering::none;
  Slip slip_ = Slip::none;
  bool stalled_to_ = false, stalled_from_ = false, cut_ = false, stale_ = false;
  TimeNs last_to_ns_ = 0, last_from_ns_ = 0, last_peer_ns_ = 0, connect_at_ns_ = 0, next_stale_ns_ = 0;
  std::optional<bool> connection_;

  std::uint64_t next_call_ = 1;                                     ///< as the ledger knows calls
  std::map<std::uint64_t, std::pair<std::uint64_t, TimeNs>> open_;  ///< by call: the caller's id, the deadline
  std::deque<Waiting> to_;
  std::deque<std::pair<TimeNs, SimulatedLedger::Ended>> outcomes_;    ///< on their way back
  std::deque<std::pair<TimeNs, SimulatedLedger::BlockPtr>> blocks_;   ///< on their way to the peer
  std::deque<std::pair<TimeNs, SimulatedLedger::BlockPtr>> ordered_;  ///< on their way to an orderer's stream
  ServingPeer peer_, orderer_;
  fabric::BlockSource source_ = fabric::BlockSource::peer;
  bool orderer_connected_ = false;
  TimeNs orderer_at_ns_ = 0;  ///< then it is asked again
  Random lags_;               ///< of the peer, behind the orderer
  TimeNs now_ = 0;
  std::optional<fabric::BlockIntake> intake_;
  bool reading_ = true;                           ///< a process is there
  std::optional<fabric::Checkpoint> checkpoint_;  ///< until its place is found
  std::optional<fabric::Checkpoint> newest_verified_;
  std::vector<std::string> contradictions_;
  std::deque<fabric::Block> newest_;  ///< that came, for `stale`
  std::vector<fabric::Block> arrived_blocks_, refused_blocks_;
  std::uint64_t next_refused_ = 0, next_ordered_refused_ = 0;  ///< of the peer and an orderer, behind a contradiction
  TimeNs next_contradiction_ns_ = 0;
  std::vector<SimulatedLedger::Ended> arrived_outcomes_;
  std::vector<std::string> acknowledged_;
  Counts counts_;
};

}  // namespace ledgerline::hil
