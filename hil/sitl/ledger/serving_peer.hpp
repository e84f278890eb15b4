#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/common.pb.h"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

/// What somebody with a peer's key can make of transactions, and of what is beside them in a block.
namespace ledgerline::hil {

/// A message of bytes that are one; of others what could be read.
template <typename Message>
Message parsed(const std::string& bytes) {
  Message message;
  message.ParseFromString(bytes);
  return message;
}

/// Of a common.Envelope: the function that its creator called; empty: it is no call.
std::string called_function(const std::string& envelope);

/// In a command: faster, no matter who signed it.
void tamper_plan(std::string& envelope);
void break_creator(std::string& envelope);
/// By this peer alone; null: by nobody.
void endorse_by(std::string& envelope, const crypto::SigningIdentity* peer);
void name_channel(std::string& envelope, const std::string& channel);

/// Whole transactions that the peer signs as their creator and endorses. `number` makes them different.
std::string own_stop(const crypto::SigningIdentity& peer, std::uint64_t number);
/// Of a command that was signed by another.
std::string own_command(const crypto::SigningIdentity& peer, const std::string& envelope, std::uint64_t number);
/// A configuration in which the peer's organisation orders; `authority`: that organisation's certificate.
std::string own_config(const crypto::SigningIdentity& peer, const std::string& authority);

/// In a common.Metadata of block signatures: that the newest configuration is that block's.
void name_config(std::string& signatures, std::uint64_t number);

/// What a peer serves its client in place of the ledger's blocks. It has its own key and may sign in its own name what
/// it likes; it has no orderer's key.
enum class PeerTampering : std::uint8_t {
  none,
  // Flags, which nobody signs.
  hides_commands,         ///< commands are flagged to have read what has changed
  hides_stops,            ///< stops are
  hides_stops_as_double,  ///< stops are flagged to be there twice
  hides_controls,         ///< whatever else is said of who has the drone
  hides_all,
  hides_some,  ///< every third transaction
  trusts_own,  ///< what the peer itself has ordered, ten times a second, and is not valid, is flagged valid
  no_flags,
  // What a block holds, with the orderers' signature as it was.
  bends_plan,        ///< faster, in a command
  bends_and_hashes,  ///< and the header fits again
  loses_block_signatures,
  swaps_block_signatures,  ///< those of the block before
  names_other_config,      ///< the orderers' are said to speak of a later configuration
  mixes_headers,           ///< the header of the block before
  // What a block holds, signed by the peer in the orderers' place.
  signs_bent_plan,
  signs_broken_creator,
  signs_without_endorsement,
  signs_outsiders_endorsement,
  signs_other_channel,
  signs_own_stop,     ///< a stop that the peer itself asks for is added
  signs_own_command,  ///< a plan that the peer itself asks for is added
  signs_left_out,     ///< the block without its last transaction
  signs_reordered,    ///< those of the next one
  signs_replayed,     ///< a command before is there again
  signs_empty,        ///< an empty block
  signs_config,       ///< the peer's organisation is the orderers' from now on
  // Which blocks.
  skips,       ///< the next but one
  repeats,     ///< the one before
  grows_old,   ///< none, and its chain ends twenty blocks before the tampering: for who starts behind it
  renumbers,   ///< the number of the next but one
  turns_away,  ///< another previous hash
  forks,       ///< a chain of its own from here on, signed by itself
  forks_unsigned,
  withholds,           ///< none
  withholds_stops,     ///< none from the first with a stop on
  withholds_commands,  ///< none with a command
  delays,              ///< each by two seconds
  stutters,            ///< each by up to a second
  garbage,             ///< bytes that are no block's
  mixes,               ///< each time another one of these
};

/// Whose keys a serving peer has.
struct PeerKeys {
  crypto::SigningIdentity peer;
  std::string authority;             ///< certificate of the peer's organisation
  crypto::SigningIdentity outsider;  ///< a peer of an organisation whose endorsement a command does not need
};
/// Of the registry for tests: a peer's, and an orderer's for one that lies as orderers may, signatures and all.
PeerKeys test_peer_keys();
PeerKeys test_orderer_keys();

/// A peer that serves a client its blocks: honest, or not. Deterministic for a seed; one thread.
class ServingPeer {
 public:
  using BlockPtr = std::shared_ptr<const common::Block>;
  /// `first`: the channel's first block.
  ServingPeer(BlockPtr first, std::uint64_t seed, PeerKeys keys = test_peer_keys());

  void set_tampering(PeerTampering tampering);
  /// What the peer has ordered now: a common.Envelope; empty: nothing.
  std::string orders(TimeNs now);
  /// The next block of the ledger has come to the peer.
  void add(TimeNs now, BlockPtr block);
  std::uint64_t height() const { return blocks_.size(); }
  /// The ledger's, whatever is served in its place; null: it has not come.
  BlockPtr at(std::uint64_t number) const;
  /// What it has for a client that waits for that block; null: nothing now.
  BlockPtr serve(TimeNs now, std::uint64_t wanted);
  /// Its newest; null: it does not say.
  BlockPtr newest(TimeNs now);
  /// One block by its number.
  Result<common::Block> fetch(std::uint64_t number) const;

 private:
  struct Kept {
    BlockPtr block;
    TimeNs came_ns = 0;
  };
  /// The first command in the newest block that has one, as an envelope; empty: none was yet.
  std::string newest_command() const;
  BlockPtr tampered(PeerTampering tampering, std::uint64_t wanted);
  bool holds_back(PeerTampering tampering, TimeNs now, const Kept& next) const;
  void tamper_flags(PeerTampering tampering, common::Block& block) const;
  bool tamper_data(PeerTampering tampering, common::Block& block);
  BlockPtr forked(PeerTampering tampering, std::uint64_t wanted);

  const PeerKeys keys_;
  PeerTampering tampering_ = PeerTampering::none;
  std::uint64_t seed_;
  std::vector<Kept> blocks_;     ///< by number
  std::uint64_t lied_from_ = 0;  ///< height that its chain had then
  TimeNs next_order_ns_ = 0;
  std::optional<std::pair<std::uint64_t, std::string>> fork_;  ///< the next number and the hash before it
};

}  // namespace ledgerline::hil
