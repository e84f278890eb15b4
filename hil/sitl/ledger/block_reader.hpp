#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.hpp"
#include "common/fabric/blocks/block_intake.hpp"
#include "hil/sitl/ledger/serving_peer.hpp"
#include "hil/sitl/ledger/simulated_ledger.hpp"

namespace ledgerline::hil {

/// Reads the blocks that a peer, and perhaps an orderer, serves to one process, and verifies them as fabric::Client
/// does: by a BlockIntake, with the channel's first block as the trust anchor, without gap or duplicate. Deterministic
/// for a seed; one thread.
class BlockReader {
 public:
  using BlockPtr = SimulatedLedger::BlockPtr;
  static constexpr TimeNs reconnect_ns = 150 * ns_per_ms;
  static constexpr std::uint64_t max_absence_blocks = 1'000;  ///< as agent's

  /// The peer has what the ledger has by now.
  BlockReader(const SimulatedLedger& ledger, std::uint64_t seed);

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

  std::vector<fabric::Block> pop_verified() { return std::exchange(verified_, {}); }
  /// That were refused: of either stream, by nobody's flag.
  std::vector<fabric::Block> pop_refused() { return std::exchange(refused_, {}); }
  /// Why a peer or orderer was left since the last call, in words.
  std::vector<std::string> pop_contradictions() { return std::exchange(contradictions_, {}); }
  /// The newest block that was verified; none: none was yet.
  const std::optional<fabric::Checkpoint>& checkpoint() const { return newest_verified_; }

 private:
  Status find_place(TimeNs now);
  Status disconnect_peer(std::string why);
  void read_behind_contradiction(TimeNs now);
  void read_ordered(TimeNs now);
  bool pop_ordered(TimeNs now);
  void disconnect_orderer(TimeNs now, std::string why);
  void refuse(const common::Block& message);
  void add_verified(fabric::Block block);

  const SimulatedLedger& ledger_;
  fabric::BlockSource source_ = fabric::BlockSource::peer;
  ServingPeer peer_, orderer_;
  bool orderer_connected_ = false;
  TimeNs orderer_at_ns_ = 0;  ///< then it is asked again
  TimeNs now_ = 0;            ///< of the last read
  std::optional<fabric::BlockIntake> intake_;
  bool reading_ = false;                          ///< a process is there
  std::optional<fabric::Checkpoint> checkpoint_;  ///< until its place is found
  std::optional<fabric::Checkpoint> newest_verified_;
  std::vector<fabric::Block> verified_, refused_;
  std::vector<std::string> contradictions_;
  // Behind a contradiction.
  std::uint64_t next_refused_ = 0, next_ordered_refused_ = 0;  ///< of the peer and the orderer
  TimeNs next_contradiction_ns_ = 0;
};

}  // namespace ledgerline::hil
