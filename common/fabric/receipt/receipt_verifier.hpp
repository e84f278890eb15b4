#pragma once
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// Members of the named organisations. Who has been revoked since is a member all the same, since a receipt outlives
/// certificates; whether its word still counts depends on what it says. Any thread.
class Members {
 public:
  /// `lists_pem`: of any of the organisations; empty: none.
  Members(std::vector<crypto::MspRoot> roots, const std::string& lists_pem);

  struct Found {
    std::shared_ptr<const crypto::MspRegistry::Member> member;
    bool revoked = false;  ///< by one of the lists
  };
  /// `serialized`: msp.SerializedIdentity. Whenever its certificate was valid.
  Result<Found> find(std::string_view serialized) const;

 private:
  std::unique_ptr<crypto::MspRegistry> all_, not_revoked_;
};

/// Whom to trust. All of it comes from who checks, nothing from the receipt.
struct ReceiptTrust {
  std::string channel;
  std::vector<crypto::MspRoot> organisations;  ///< of the channel: a majority of these has to say the verdict
  std::vector<crypto::MspRoot> orderers;       ///< organisations of orderers
  std::string revocation_lists_pem{};          ///< of any of these; empty: nobody looks at revocation
};

/// What a receipt proves, and by whose word.
struct ReceiptProof {
  std::string channel, tx_id;
  std::uint64_t block = 0;
  std::string block_hash;                      ///< hex, of its header: what the next block names
  std::vector<crypto::IdentityName> orderers;  ///< by their word the transaction is in this block
  crypto::IdentityName creator;                ///< by its own word: contract, function, arguments, time
  std::string contract, function;
  std::vector<std::string> arguments;
  TimeNs timestamp_ns = 0;
  std::vector<crypto::IdentityName> endorsers;  ///< whose endorsements of this call are good
  int code = 0;                                 ///< protos.TxValidationCode
  std::string verdict;                          ///< its name
  std::vector<crypto::IdentityName> peers;      ///< by their word the verdict is that
  std::size_t organisations = 0;                ///< of these, peers of more than half have said so
  /// The block's other transactions, which the receipt shows as well. What they say of themselves; nothing is checked.
  struct Other {
    std::string tx_id;
    crypto::IdentityName creator;  ///< no names: it cannot be read, or is of nobody who is known
  };
  std::vector<Other> others;

  /// A certificate by which something is proven, and what else there is to know of it.
  struct Certificate {
    enum class Role { orderer, creator, endorser, peer };
    Role role = Role::peer;
    crypto::IdentityName who;
    std::int64_t valid_from_s = 0, valid_to_s = 0;  ///< Unix time
    std::int64_t used_s = 0;  ///< when its key signed, as claimed: by the creator; for a peer's answer by the asker
    bool revoked = false;     ///< by a list of ReceiptTrust
    bool valid_when_used() const { return valid_from_s <= used_s && used_s <= valid_to_s; }
  };
  std::vector<Certificate> certificates;
  std::vector<crypto::RevocationList> revocation_lists;  ///< that were looked at
  std::vector<std::string> without_list;                 ///< organisations of which there was no list
};

/// Checks receipts, without any network. Proven is, in this order:
/// - the block is as one orderer or more of the named organisations signed it (each signature in it counts; Fabric's
///   default policy wants one. Where the channel's policy wants more, one orderer's word is proven and not more);
/// - the transaction is in it, is of this channel, has its creator's signature, and its id is of that creator;
/// - peers (OU=peer) of more than half of the named organisations signed one and the same verdict on this very
///   transaction. Validity is signed nowhere else: a lying majority would be trusted, as by the channel itself.
/// Certificates must be of the named authorities, and count whenever they were valid, as in a block of Fabric's: a
/// receipt outlives them. Who is on a revocation list has no word any more as orderer or as answering peer, since the
/// receipt has no time that its key's thief could not claim. Creator and endorsers stay what they were: the channel's
/// peers validated them when the transaction came, and their verdict is what is proven. All of it is reported beside
/// that (ReceiptProof::Certificate). Any thread; checked certificates are kept between receipts.
class ReceiptVerifier {
 public:
  /// An error names the certificate that cannot be read, or what is missing.
  static Result<ReceiptVerifier> from(ReceiptTrust trust);

  /// The error names the first thing that is wrong.
  Result<ReceiptProof> verify(std::string_view receipt) const;

 private:
  ReceiptVerifier() = default;

  std::string channel_;
  std::size_t organisation_count_ = 0;
  std::unique_ptr<Members> organisations_, orderers_;
  std::vector<crypto::RevocationList> lists_;
  std::vector<std::string> without_list_;
};

}  // namespace ledgerline::fabric
