#pragma once
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/channel_state.hpp"

/// Which of a block's transactions are valid: the rule by which Fabric's peers flag them, for everybody who does not
/// want to take a peer's word. From an unmodified peer the flags differ in no transaction (tests/system/validation
/// compares them). Pure but for the registry's cache. One thread.
namespace ledgerline::fabric {

struct TransactionVerdict {
  std::string tx_id;
  int code = 0;          ///< protos.TxValidationCode
  const char* why = "";  ///< in words, unless it is VALID
  bool config = false;   ///< whether it may configure the channel is not validated here: BlockValidator follows it
  /// It rests on something that the state does not know: it is as the peer flagged it, and in a block without flags a
  /// guess, on which nobody may act.
  bool by_flag = false;
  /// In a block without flags: it has to do with keys of the hot path alone (ChannelState::is_of_hot_path). Its
  /// creator may have used its id before the state knows ids; then peers flag it as a duplicate.
  bool repeatable = false;
  bool signature_verified = false;  ///< the creator's
  std::string creator_msp{};        ///< of a creator who signed
  /// Of each endorsement, as far as they were looked at: it is a member's. Once they are enough, no further one is.
  std::vector<bool> endorsements_verified{};
  std::vector<PolicySigner> endorsers{};  ///< likewise, each once
  ReadWriteSet sets{};                    ///< of a valid one, or of one that is invalid by its flag alone
};

struct ValidationRules {
  std::string channel = "teleop";
  /// Events that name another transaction than their own. Fabric takes them, and its readers are misled.
  bool foreign_events = true;
};

/// Of each transaction in the block, in its order: form, creator, transaction id, contract, endorsements by the
/// policies of what it writes (those before the block: who writes a key whose policy the block has changed before it,
/// is invalid), and that what it read is as it was. Where the state is not whole, what it does not know is taken from
/// the block's flags, if it has some. Certificates count whenever they were valid, as in Fabric, and not when they are
/// revoked. `members`: of all organisations of the channel, the orderers' among them. Signatures are of a block that
/// BlockValidator passed.
std::vector<TransactionVerdict> validate_transactions(const common::Block& block, const ChannelState& state,
                                                      crypto::MspRegistry& members, const ValidationRules& rules);

}  // namespace ledgerline::fabric
