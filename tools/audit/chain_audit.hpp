#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/fabric/validation/block_validator.hpp"
#include "common/fabric/validation/key_state.hpp"
#include "tools/audit/report.hpp"

namespace ledgerline::audit {

/// "MVCC_READ_CONFLICT"; a number that Fabric has no name for: itself.
std::string code_name(int code);

/// Something that is not as it must be.
struct Finding {
  std::uint64_t block = 0;
  std::optional<std::size_t> transaction{};  ///< its place in the block; nullopt: the block itself
  std::string tx_id{};
  std::string what;
};
/// "block 17, transaction 3 (0a1b...): its flag is VALID, but ..."
std::string to_text(const Finding& finding);

/// Whom to trust.
struct Trust {
  std::string channel = "teleop";
  /// common.Block with a configuration of the channel, from somebody who is trusted: any one of the chain's. Empty: the
  /// first block that comes is taken as it is, and its author is trusted.
  std::string anchor;
  crypto::Library library = crypto::Library::libcrypto;
  std::string newest{};  ///< hash of the newest block's header that somebody else has seen, hex; empty: none is known
};

struct Counts {
  std::uint64_t blocks = 0, config_blocks = 0, transactions = 0, valid = 0;
  std::uint64_t without_flags = 0;       ///< blocks as orderers have them: nothing to compare with
  std::map<int, std::uint64_t> invalid;  ///< by protos.TxValidationCode, own verdict
  std::uint64_t endorsements = 0;
  std::uint64_t findings = 0;
};

/// Validates a channel's whole chain, block by block from number 0: form, order and hashes; the orderers' signatures;
/// each transaction by Fabric's own rule, against the flag that the peer gave it; control events against the records
/// before. What is verified goes into the report. Goes on behind a finding as well as it can, so that what follows a
/// first one may follow from it. Memory: that of KeyState, the report's bounds, and max_findings. Pure; one thread.
class ChainAudit {
 public:
  /// An error: the anchor is no configuration of that channel.
  /// `span`: what the report is about.
  static Result<ChainAudit> start(Trust trust, TimeSpan span = {});

  /// The next block of the chain, a common.Block.
  void add(std::string_view block);
  /// A finding of the chain's reader, where the next block should be.
  void add_reader_finding(const std::string& what);
  /// Behind the last block: that the anchor was in the chain, and that it is the newest one.
  void end();

  static constexpr std::size_t max_findings = 1'000;
  const std::vector<Finding>& findings() const { return findings_; }  ///< the first ones
  const Counts& counts() const { return counts_; }
  const ChainReport& report() const { return *report_; }
  std::uint64_t height() const { return next_; }
  /// Of the newest block's header, hex.
  std::string newest_hash() const { return crypto::hex(hash_.value_or("")); }

 private:
  ChainAudit(Trust trust, TimeSpan span) : trust_(std::move(trust)), report_(std::make_unique<ChainReport>(span)) {}
  void add_finding(std::optional<std::size_t> transaction, const std::string& tx_id, std::string what);
  bool follow_chain(const common::Block& block);
  void validate_orderers(const common::Block& block);
  void check_anchor(const common::Block& block);
  void configure(const fabric::ChannelConfig& config);
  void validate_transactions(const common::Block& block, std::string_view bytes);
  void compare(const common::Block& block, const std::vector<fabric::TransactionVerdict>& verdicts);
  void add_to_report(const fabric::Block& block, const std::vector<fabric::TransactionVerdict>& verdicts);

  Trust trust_;
  std::uint64_t next_ = 0;           ///< number of the block that must come
  std::optional<std::string> hash_;  ///< of the header of the one before; nullopt: could not be read
  bool hash_is_known_ = true;
  std::uint64_t anchor_number_ = 0;
  std::string anchor_hash_, anchor_signatures_;
  bool anchor_seen_ = false;
  std::optional<fabric::BlockValidator> orderers_;
  bool orderers_missing_said_ = false;
  fabric::ValidationRules rules_;
  fabric::KeyState state_;
  std::unique_ptr<crypto::MspRegistry> members_;
  std::unique_ptr<ChainReport> report_;
  std::vector<Finding> findings_;
  Counts counts_;
};

/// What was audited, beside what was found.
struct AuditRequest {
  std::string channel, source;
  std::string anchor;              ///< file; empty: the first block was taken as it is
  std::set<std::string> drones{};  ///< that are reported; none: all
  TimeSpan span{};                 ///< that is reported
  bool reports(const std::string& drone) const { return drones.empty() || drones.contains(drone); }
  /// What is counted where not the whole chain is reported: "in that time, of all drones"; empty: the whole chain.
  std::string counted() const {
    const bool all_times = span.is_from_the_start() && span.is_to_the_end();
    if (drones.empty()) return all_times ? "" : "in that time";
    return all_times ? "of all drones" : "in that time, of all drones";
  }
};

/// "nothing found: ... up to block 17 (hash 0a1b...)", or the first finding.
std::string verdict(const ChainAudit& audit);
/// For a terminal: one or two screens. The last line names the first finding, or says that there is none.
std::string to_table(const ChainAudit& audit, const AuditRequest& asked);
/// The object of --json. Times are in seconds since 1970, as clients claimed them.
nlohmann::json to_json(const ChainAudit& audit, const AuditRequest& asked);
/// The page, from that object. Self-contained.
std::string to_page(nlohmann::json document);

}  // namespace ledgerline::audit
