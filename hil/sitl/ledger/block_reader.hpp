#pragma once
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.hpp"
#include "common/fabric/blocks/block_intake.hpp"
#include "hil/sitl/ledger/serving_peer.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"

namespace ledgerline::hil {

using VerifiedBlock = std::shared_ptr<const fabric::Block>;

/// Verifies each block once for all readers who began at the same one and were given the ledger's own since then: a
/// BlockIntake makes the same of the same blocks. One thread.
class CommonIntake {
 public:
  CommonIntake(const SimulatedLedger& ledger, std::uint64_t first);

  /// The ledger's own block of that number. Null: it is refused, or so old that it is not kept any more.
  VerifiedBlock verify(TimeNs now, const SimulatedLedger::BlockPtr& block);

 private:
  static constexpr std::size_t max_kept = 64;  ///< by how much one reader may be behind another

  const SimulatedLedger& ledger_;
  TimeNs now_ = 0;
  fabric::BlockIntake intake_;
  std::deque<std::pair<SimulatedLedger::BlockPtr, VerifiedBlock>> newest_;
};

/// Reads the blocks that a peer, and perhaps an orderer, serves to one process, and verifies them as fabric::Client
/// does: by a BlockIntake, with the channel's first block as the trust anchor, without gap or duplicate. Deterministic
/// for a seed; one thread. While it is given what other readers are, they have a CommonIntake; with the first block
/// that is another one it goes on alone, and makes of that one what it would have alone all along.
class BlockReader {
 public:
  using BlockPtr = SimulatedLedger::BlockPtr;
  static constexpr TimeNs reconnect_ns = 150 * ns_per_ms;
  static constexpr std::uint64_t max_absence_blocks = 1'000;  ///< as agent's

  /// The peer has what the ledger has by now.
  BlockReader(SimulatedLedger& ledger, std::uint64_t seed);

  /// Of a process that begins from now on.
  void set_block_source(fabric::BlockSource source) { source_ = source; }
  bool reads_ordered() const { return source_ != fabric::BlockSource::peer; }
  /// What each of them serves in place of the ledger's blocks; the orderer has an orderer's key.
  void serve(PeerTampering tampering) { peer_.set_tampering(tampering); }
  void order(PeerTampering tampering) { orderer_.set_tampering(tampering); }

  /// A block of the ledger has come to the peer, or to the orderer.
  void add(TimeNs now, BlockPtr block) { peer_.add(now, std::move(block)); }
  void add_ordered(TimeNs now, BlockPtr block) { orderer_.add(now, std::move(block)); }
  /// What the peer itself has ordered now: a common.Envelope; empty: nothing.
  std::string envelope_of_peer(TimeNs now) { return peer_.orders(now); }

  /// A process begins: it reads the next new block first, or goes on behind the checkpoint.
  void begin(std::optional<fabric::Checkpoint> from);
  /// It died.
  void end();
  /// The connection is there again; false: the peer has contradicted itself, and only what counts by its signature
  /// alone is still read.
  bool connect();
  /// Everything that is served now. The error says why the peer is to be left; it is in the contradictions.
  Status read(TimeNs now);

  std::vector<VerifiedBlock> pop_verified() { return std::exchange(verified_, {}); }
  /// That were refused: of either stream, by nobody's flag.
  std::vector<fabric::Block> pop_refused() { return std::exchange(refused_, {}); }
  /// Why a peer or orderer was left since the last call, in words.
  std::vector<std::string> pop_contradictions() { return std::exchange(contradictions_, {}); }
  /// The newest block that was verified; none: none was yet.
  std::optional<fabric::Checkpoint> checkpoint() const;

 private:
  Status find_place(TimeNs now);
  Status disconnect_peer(std::string why);
  void read_behind_contradiction(TimeNs now);
  void read_ordered(TimeNs now);
  bool pop_ordered(TimeNs now);
  void disconnect_orderer(TimeNs now, std::string why);
  void refuse(const common::Block& message);
  std::uint64_t next_of_peer() const;
  void add_verified(VerifiedBlock block);
  void go_alone();
  fabric::BlockIntake::Fetch fetch() const;

  SimulatedLedger& ledger_;
  fabric::BlockSource source_ = fabric::BlockSource::peer;
  ServingPeer peer_, orderer_;
  bool orderer_connected_ = false;
  TimeNs orderer_at_ns_ = 0;                   ///< then it is asked again
  TimeNs now_ = 0;                             ///< of the last read
  std::optional<fabric::BlockIntake> intake_;  ///< none while there is a common one
  std::shared_ptr<CommonIntake> common_;
  std::uint64_t first_ = 0;                       ///< block of the common one
  std::vector<TimeNs> read_ns_;                   ///< when each of its blocks was read, from the first on
  bool reading_ = false;                          ///< a process is there
  std::optional<fabric::Checkpoint> checkpoint_;  ///< until its place is found
  std::optional<fabric::Checkpoint> began_behind_;
  VerifiedBlock newest_verified_;
  std::vector<VerifiedBlock> verified_;
  std::vector<fabric::Block> refused_;
  std::vector<std::string> contradictions_;
  // Behind a contradiction.
  std::uint64_t next_refused_ = 0, next_ordered_refused_ = 0;  ///< of the peer and the orderer
  TimeNs next_contradiction_ns_ = 0;
};

}  // namespace ledgerline::hil
