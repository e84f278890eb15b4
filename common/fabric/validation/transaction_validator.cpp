#include "common/fabric/validation/transaction_validator.hpp"

#include <algorithm>
#include <functional>
#include <set>
#include <unordered_set>

#include "common/base/check.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/block_overlay.hpp"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr TimeNs max_clock_error_ns = 5 * ns_per_s;  // of creators that keep their clocks

/// A certificate however its PEM is laid out: of one identity only one endorsement counts.
std::string without_layout(std::string pem) {
  std::erase_if(pem, [](unsigned char c) { return c <= ' '; });
  return pem;
}

class TransactionValidator {
 public:
  TransactionValidator(const ChannelState& state, crypto::MspRegistry& members, const ValidationRules& rules)
      : state_(state), members_(members), rules_(rules), overlay_(state) {}

  /// `reported`: the peer's flag, which counts where the state does not know enough.
  TransactionVerdict validate(std::string_view envelope, std::optional<int> reported) {
    TransactionVerdict verdict;
    const TransactionForm form =
        read_form(envelope, [&](const std::string& creator, const std::string& payload, const std::string& signature) {
          const auto member = members_.member(creator, std::nullopt);
          verdict.signature_verified = member && (*member)->verifier->verify(payload, signature);
          if (verdict.signature_verified) verdict.creator_msp = (*member)->name.msp_id;
          return verdict.signature_verified;
        });
    verdict.tx_id = form.channel_header.tx_id();
    verdict.config = form.config;
    verdict.code = form.code;
    // A malformed result is reported only after a used id and a malformed header extension.
    const bool formed = form.code == protos::VALID || form.code == protos::BAD_RESPONSE_PAYLOAD;
    if (!formed) return refuse(std::move(verdict), form.code, "its form or its creator's signature is wrong");
    if (form.channel_header.channel_id() != rules_.channel)
      return refuse(std::move(verdict), protos::TARGET_CHAIN_NOT_FOUND, "it is of another channel");
    if (form.config) return verdict;
    if (state_.knows_transaction(verdict.tx_id)) {
      verdict.by_flag = state_.is_claimed(verdict.tx_id);
      return refuse(std::move(verdict), protos::DUPLICATE_TXID, "its id was used before");
    }
    ReadWriteSet sets;
    unknown_ = false;
    flagged_ = reported.has_value();
    const Failure failure = endorsed(form, sets, verdict.endorsements_verified, verdict.endorsers);
    if (failure.code != protos::VALID) return refuse(std::move(verdict), failure.code, failure.why, reported);
    if (unknown_ && is_of_endorsement(reported)) return refuse_by_flag(std::move(verdict), *reported, std::move(sets));
    if (reported == protos::DUPLICATE_TXID && !ids_.contains(verdict.tx_id) && may_be_older(sets)) {
      overlay_.add_possible_policies(sets);
      return refuse_by_flag(std::move(verdict), *reported, std::move(sets));
    }
    if (!flagged_ && !state_.whole()) {
      verdict.repeatable = is_repeatable(sets);
      unknown_ = unknown_ || (may_be_older(sets) && !is_newer(form.channel_header.timestamp()));
    }
    overlay_.add_policies(sets);
    // As in Fabric, a transaction that fails for what it read has used its id up, also within the block.
    if (!ids_.insert(verdict.tx_id).second)
      return refuse(std::move(verdict), protos::DUPLICATE_TXID, "its id was used before in this block");
    const BlockOverlay::Checked checked = overlay_.check(sets);
    unknown_ = unknown_ || checked.unknown;
    if (checked.code != protos::VALID)
      return refuse(std::move(verdict), checked.code, "what it read has changed since", reported);
    if (unknown_ && reported && *reported != protos::VALID)
      return refuse_by_flag(std::move(verdict), *reported, std::move(sets));
    verdict.by_flag = unknown_;
    overlay_.add(sets);
    verdict.sets = std::move(sets);
    return verdict;
  }

 private:
  struct Failure {
    int code = protos::VALID;
    const char* why = "";
  };

  static TransactionVerdict refuse(TransactionVerdict verdict, int code, const char* why) {
    verdict.code = code;
    verdict.why = why;
    return verdict;
  }
  /// It is invalid in any case; where something before that is not known, the flag may name the first reason.
  TransactionVerdict refuse(TransactionVerdict verdict, int code, const char* why, std::optional<int> reported) const {
    if (unknown_ && !reported) verdict.by_flag = true;
    if (unknown_ && reported && *reported != protos::VALID) {
      verdict.by_flag = verdict.by_flag || code != *reported;
      code = *reported;
    }
    return refuse(std::move(verdict), code, why);
  }

  /// `sets`: what it has written nevertheless, if that is not so.
  static TransactionVerdict refuse_by_flag(TransactionVerdict verdict, int reported, ReadWriteSet sets) {
    verdict.by_flag = true;
    verdict.sets = std::move(sets);
    return refuse(std::move(verdict), reported, "the peer says so");
  }

  /// Whether the same transaction may have been ordered before what the state knows: what has read a version of a later
  /// block was made behind that.
  bool may_be_older(const ReadWriteSet& sets) const {
    if (state_.whole()) return false;
    for (const NamespaceSet& part : sets.parts) {
      for (const kvrwset::KVRead& read : part.set.reads()) {
        if (read.has_version() && read.version().block_num() >= state_.ids_since()) return false;
      }
    }
    return true;
  }

  /// Whether it writes the hot path's keys alone, and has read none of them. Another transaction's verdict must not
  /// depend on whether one that was delivered before is the newest of its key.
  bool is_repeatable(const ReadWriteSet& sets) const {
    return std::all_of(sets.parts.begin(), sets.parts.end(), [&](const NamespaceSet& part) {
      const auto of_hot_path = [&](const auto& one) {
        return state_.is_of_hot_path({part.name, part.collection, one.key()});
      };
      return part.set.metadata_writes().empty() && part.set.range_queries_info().empty() &&
             std::all_of(part.set.writes().begin(), part.set.writes().end(), of_hot_path) &&
             std::none_of(part.set.reads().begin(), part.set.reads().end(), of_hot_path);
    });
  }

  /// Whether it was made when all ids were known already, by its creator's clock.
  bool is_newer(const google::protobuf::Timestamp& made) const {
    const auto since_ns = state_.ids_since_ns();
    return since_ns && time_of(made) > *since_ns + max_clock_error_ns;
  }

  /// Whether a peer that gives this code has found too few endorsements, or no contract.
  static bool is_of_endorsement(std::optional<int> code) {
    return code && *code != protos::VALID && *code != protos::DUPLICATE_TXID && *code != protos::MVCC_READ_CONFLICT &&
           *code != protos::PHANTOM_READ_CONFLICT;
  }

  /// Who has endorsed, each once, until those found are enough: nothing follows from more of them.
  std::vector<PolicySigner> endorsers_of(const TransactionForm& form, std::vector<bool>& verified,
                                         const std::function<bool(const std::vector<PolicySigner>&)>& are_enough) {
    std::vector<PolicySigner> found;
    std::set<std::string> known;
    for (const protos::Endorsement& endorsement : form.endorsements) {
      const auto member = members_.member(endorsement.endorser(), std::nullopt);
      verified.push_back(false);
      if (!member) continue;
      const std::string identity = (*member)->name.msp_id + ' ' + without_layout((*member)->pem);
      if (known.contains(identity) ||
          !(*member)->verifier->verify(form.response_payload + endorsement.endorser(), endorsement.signature()))
        continue;
      known.insert(identity);
      verified.back() = true;
      found.push_back({(*member)->name.msp_id, (*member)->peer, (*member)->orderer, identity});
      if (are_enough(found)) break;
    }
    return found;
  }

  /// That header and result are of one contract.
  static Failure check_contract(const protos::ChaincodeHeaderExtension& called, const protos::ChaincodeAction& result) {
    if (!called.has_chaincode_id() || !result.has_chaincode_id())
      return {protos::INVALID_OTHER_REASON, "it names no contract"};
    const std::string& name = called.chaincode_id().name();
    if (name.empty() || name != result.chaincode_id().name() || result.chaincode_id().version().empty())
      return {protos::INVALID_CHAINCODE, "its result is of another contract, or of no version"};
    return {};
  }

  /// An event that names another contract would reach readers under a false name.
  Failure check_event(const TransactionForm& form, const std::string& contract) const {
    if (form.action.events().empty()) return {};
    protos::ChaincodeEvent event;
    if (!event.ParseFromString(form.action.events()) || event.chaincode_id() != contract)
      return {protos::INVALID_OTHER_REASON, "its event is of another contract"};
    if (!rules_.foreign_events && event.tx_id() != form.channel_header.tx_id())
      return {protos::INVALID_OTHER_REASON, "its event names another transaction"};
    return {};
  }

  Failure endorsed(const TransactionForm& form, ReadWriteSet& sets, std::vector<bool>& verified,
                   std::vector<PolicySigner>& endorsers) {
    protos::ChaincodeHeaderExtension called;
    if (!called.ParseFromString(form.channel_header.extension()))
      return {protos::BAD_HEADER_EXTENSION, "its header extension is malformed"};
    if (form.code != protos::VALID) return {form.code, "its proposal response is malformed"};
    sets = read_sets(form.action.results());
    if (sets.code == protos::BAD_RWSET) return {sets.code, "what it read and wrote is malformed"};
    const std::string& contract = called.chaincode_id().name();
    if (const Failure failure = check_contract(called, form.action); failure.code != protos::VALID) return failure;
    if (const Failure failure = check_event(form, contract); failure.code != protos::VALID) return failure;
    if (sets.code != protos::VALID) return {sets.code, "it names a namespace twice"};
    std::set<std::string> namespaces{contract};
    for (const NamespaceSet& part : sets.parts) {
      if (part.writes()) namespaces.insert(part.name);
    }
    endorsers = endorsers_of(form, verified, [&](const std::vector<PolicySigner>& found) {
      unknown_ = false;
      return std::all_of(namespaces.begin(), namespaces.end(),
                         [&](const std::string& name) { return satisfies_policies(name, sets, found); }) &&
             !unknown_;
    });
    LEDGERLINE_CHECK(endorsers.size() <= verified.size(), "each endorser is of an endorsement", endorsers.size(),
                     verified.size());
    unknown_ = false;
    for (const std::string& name : namespaces) {
      if (state_.whole() && !state_.policy_of(name, ""))
        return {protos::INVALID_CHAINCODE, "it writes to a contract that is not there"};
      if (!satisfies_policies(name, sets, endorsers))
        return {protos::ENDORSEMENT_POLICY_FAILURE, "its endorsements do not satisfy the policies of what it writes"};
    }
    return {};
  }

  /// What somebody says of a policy confirms a flag, and nothing without one.
  bool may_confirm(const std::string& name) const { return flagged_ || !state_.policy_is_unverified(name); }

  bool satisfies_policy_of(const std::string& name, const std::string& collection,
                           const std::vector<PolicySigner>& endorsers) {
    const auto policy = state_.policy_of(name, collection);
    if (policy && satisfies(*policy, endorsers) && (state_.whole() || may_confirm(name))) return true;
    if (state_.whole() || (policy && !state_.policy_is_unverified(name))) return false;
    unknown_ = true;
    return true;
  }

  /// Fabric's rule: a key with a policy of its own needs what that says, the others what their namespace's or
  /// collection's says; so does a transaction that writes nothing.
  bool satisfies_policies(const std::string& name, const ReadWriteSet& sets,
                          const std::vector<PolicySigner>& endorsers) {
    bool any = false;
    for (const NamespaceSet& part : sets.parts) {
      if (part.name != name) continue;
      std::set<std::string> keys;
      for (const kvrwset::KVWrite& write : part.set.writes()) keys.insert(write.key());
      for (const kvrwset::KVMetadataWrite& write : part.set.metadata_writes()) keys.insert(write.key());
      bool common_policy = false;
      for (const std::string& key : keys) {
        const KeyName whole{name, part.collection, key};
        any = true;
        if (overlay_.has_new_policy(whole)) return false;
        unknown_ = unknown_ || overlay_.may_have_new_policy(whole);
        if (!state_.known(whole).policy) {
          const auto own = state_.likely_policy(whole);
          const auto common = state_.policy_of(name, part.collection);
          const bool by_own = own && satisfies(*own, endorsers), by_common = common && satisfies(*common, endorsers);
          if (own && common && !by_own && !by_common && !state_.policy_is_unverified(name)) return false;
          const bool both = by_own && by_common && may_confirm(name);
          unknown_ = unknown_ || (!both && !state_.have_sufficed(whole, endorsers));
          continue;
        }
        const auto found = state_.find(whole);
        if (!found || found->policy.empty()) {
          common_policy = true;
        } else if (!satisfies(found->policy, endorsers)) {
          return false;
        }
      }
      if (common_policy && !satisfies_policy_of(name, part.collection, endorsers)) return false;
    }
    return any || satisfies_policy_of(name, "", endorsers);
  }

  const ChannelState& state_;
  crypto::MspRegistry& members_;
  const ValidationRules& rules_;
  BlockOverlay overlay_;
  std::unordered_set<std::string> ids_;
  bool unknown_ = false;  ///< the verdict so far rests on something that the state does not know
  bool flagged_ = false;  ///< a peer has said what the transaction is
};

}  // namespace

std::vector<TransactionVerdict> validate_transactions(const common::Block& block, const ChannelState& state,
                                                      crypto::MspRegistry& members, const ValidationRules& rules) {
  TransactionValidator validator(state, members, rules);
  const auto count = static_cast<std::size_t>(block.data().data_size());
  const std::string_view flags = state.whole() ? std::string_view{} : flags_of(block);
  std::vector<TransactionVerdict> verdicts;
  verdicts.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto reported =
        flags.size() == count ? std::optional<int>(static_cast<unsigned char>(flags[i])) : std::nullopt;
    const TransactionVerdict& verdict =
        verdicts.emplace_back(validator.validate(block.data().data(static_cast<int>(i)), reported));
    LEDGERLINE_CHECK(verdict.code != protos::VALID || verdict.config || verdict.signature_verified,
                     "what counts was signed by its creator", block.header().number(), i, verdict.tx_id);
  }
  return verdicts;
}

}  // namespace ledgerline::fabric
