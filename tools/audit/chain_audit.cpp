#include "tools/audit/chain_audit.hpp"

#include <fmt/format.h>

#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::audit {
namespace {

constexpr std::size_t max_shown = 200;  // of what others wrote

bool parse(std::string_view bytes, common::Block& block) {
  return bytes.size() <= INT32_MAX && block.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

std::string hash_of(const common::BlockHeader& header) {
  return fabric::block_header_hash(header.number(), header.previous_hash(), header.data_hash());
}

const std::string& metadata(const common::Block& block, int index) {
  static const std::string none;
  return block.metadata().metadata_size() > index ? block.metadata().metadata(index) : none;
}

/// Bytes beside what the orderers signed that are in no field of theirs: nobody has signed them.
bool has_unsigned_bytes(const common::Block& block) {
  const std::string& bytes = metadata(block, common::SIGNATURES);
  common::Metadata said;
  if (!said.ParseFromString(bytes)) return false;  // BlockValidator reports it
  common::Metadata known;
  known.set_value(said.value());
  for (const common::MetadataSignature& one : said.signatures()) {
    common::MetadataSignature& copy = *known.add_signatures();
    copy.set_signature_header(one.signature_header());
    copy.set_signature(one.signature());
  }
  return known.SerializeAsString() != bytes;
}

/// The first block configures a channel that has nobody yet: its transaction has no creator, the anchor stands for it.
std::vector<fabric::TransactionVerdict> first_verdict() {
  fabric::TransactionVerdict verdict;
  verdict.code = protos::VALID;
  verdict.config = true;
  return {verdict};
}

}  // namespace

std::string code_name(int code) {
  const std::string& name = protos::TxValidationCode_Name(static_cast<protos::TxValidationCode>(code));
  return name.empty() ? fmt::format("code {}", code) : name;
}

std::string to_text(const Finding& finding) {
  if (!finding.transaction) return fmt::format("block {}: {}", finding.block, finding.what);
  const std::string id = finding.tx_id.empty() ? "" : fmt::format(" ({})", printable(finding.tx_id, max_shown));
  return fmt::format("block {}, transaction {}{}: {}", finding.block, *finding.transaction, id, finding.what);
}

std::string verdict(const ChainAudit& audit) {
  if (!audit.findings().empty()) return "first difference: " + to_text(audit.findings().front());
  if (audit.height() == 0) return "nothing found: no block was shown";
  return fmt::format("nothing found: everything is as it must be up to block {} (hash {}); later blocks were not shown",
                     audit.height() - 1, audit.newest_hash());
}

Result<ChainAudit> ChainAudit::start(Trust trust, TimeSpan span) {
  ChainAudit audit(std::move(trust), span);
  audit.rules_.channel = audit.trust_.channel;
  if (audit.trust_.anchor.empty()) return audit;
  auto validator = fabric::BlockValidator::from(audit.trust_.anchor, audit.trust_.channel, audit.trust_.library);
  if (!validator) return validator.error();
  common::Block anchor;
  if (!parse(audit.trust_.anchor, anchor)) return Error{"the anchor cannot be parsed"};
  audit.anchor_number_ = anchor.header().number();
  audit.anchor_hash_ = hash_of(anchor.header());
  audit.anchor_signatures_ = metadata(anchor, common::SIGNATURES);
  if (audit.anchor_number_ == 0) {
    auto config = fabric::read_channel_config(anchor);
    if (!config) return config.error();
    audit.configure(*config);
    audit.orderers_ = std::move(*validator);
  }
  return audit;
}

void ChainAudit::add_finding(std::optional<std::size_t> transaction, const std::string& tx_id, std::string what) {
  ++counts_.findings;
  if (const std::string prefix = fmt::format("block {}: ", next_); what.starts_with(prefix))
    what.erase(0, prefix.size());
  if (findings_.size() < max_findings) findings_.push_back({next_, transaction, tx_id, printable(what)});
}

void ChainAudit::add_reader_finding(const std::string& what) { add_finding(std::nullopt, "", what); }

void ChainAudit::end() {
  if (!trust_.anchor.empty() && !anchor_seen_)
    add_finding(
        std::nullopt, "",
        fmt::format("the chain ends before block {}, the trust anchor: nothing shows whose it is", anchor_number_));
  if (!trust_.newest.empty() && newest_hash() != trust_.newest)
    add_finding(
        std::nullopt, "",
        fmt::format(
            "the newest block that was shown has the hash {}, not {}: later ones are missing, or have come since",
            newest_hash(), trust_.newest));
}

void ChainAudit::configure(const fabric::ChannelConfig& config) {
  members_ = crypto::make_msp_registry(trust_.library, fabric::everybody(config));
  rules_.foreign_events = !config.embedded_node;
  state_.configure(config);
  if (config.embedded_node) state_.define("ledgerline");
}

void ChainAudit::add(std::string_view bytes) {
  ++counts_.blocks;
  common::Block block;
  if (!parse(bytes, block)) {
    add_finding(std::nullopt, "", "it is no block");
    hash_is_known_ = false;
    ++next_;
    return;
  }
  if (!follow_chain(block)) {
    ++next_;
    return;
  }
  check_anchor(block);
  validate_orderers(block);
  validate_transactions(block, bytes);
  hash_ = hash_of(block.header());
  hash_is_known_ = true;
  ++next_;
}

/// Number and previous hash; false: the block is of another place, and says nothing of this one.
bool ChainAudit::follow_chain(const common::Block& block) {
  if (block.header().number() != next_) {
    add_finding(std::nullopt, "", fmt::format("block {} is in its place", block.header().number()));
    hash_is_known_ = false;
    return false;
  }
  if (hash_is_known_ && block.header().previous_hash() != hash_.value_or(""))
    add_finding(std::nullopt, "",
                next_ == 0 ? "it names a block before it" : "its previous hash is not that of the block before");
  return true;
}

void ChainAudit::check_anchor(const common::Block& block) {
  if (next_ == 0 && !orderers_) {  // the anchor is a later one, what is before it counts by its hash; or there is none
    auto validator = fabric::BlockValidator::from(block.SerializeAsString(), trust_.channel, trust_.library);
    auto config = fabric::read_channel_config(block);
    if (validator && config) {
      orderers_ = std::move(*validator);
      configure(*config);
    } else {
      add_finding(std::nullopt, "", validator ? config.error().message : validator.error().message);
    }
  }
  if (trust_.anchor.empty() || next_ != anchor_number_) return;
  anchor_seen_ = true;
  if (hash_of(block.header()) != anchor_hash_)
    add_finding(std::nullopt, "", "it is another block than the trust anchor");
  // Nobody signs the first block, so what stands in the place of signatures is as the anchor has it.
  if (next_ == 0 && metadata(block, common::SIGNATURES) != anchor_signatures_)
    add_finding(std::nullopt, "", "its signatures are not those of the trust anchor");
}

void ChainAudit::validate_orderers(const common::Block& block) {
  if (!orderers_) {
    if (!orderers_missing_said_)
      add_finding(std::nullopt, "", "no configuration is known: signatures cannot be validated");
    orderers_missing_said_ = true;
    return;
  }
  if (const Status status = orderers_->validate(block); !status) {
    add_finding(std::nullopt, "", status.error().message);
  } else if (has_unsigned_bytes(block)) {
    add_finding(std::nullopt, "", "there are bytes among its signatures that nobody has signed");
  }
}

void ChainAudit::validate_transactions(const common::Block& block, std::string_view bytes) {
  if (!members_) return;
  const auto verdicts = next_ == 0 ? first_verdict() : fabric::validate_transactions(block, state_, *members_, rules_);
  const std::uint64_t found_before = counts_.findings;
  compare(block, verdicts);
  const auto decoded = fabric::decode_block(bytes);
  if (decoded) {
    add_to_report(*decoded, verdicts);
  } else if (verdicts.size() == 1 && counts_.findings == found_before) {
    add_finding(0, verdicts[0].tx_id, decoded.error().message);
  } else {
    add_finding(std::nullopt, "", decoded.error().message);
  }
  if (next_ > 0) state_.apply(next_, verdicts);
  counts_.transactions += verdicts.size();
  for (const fabric::TransactionVerdict& verdict : verdicts) {
    if (verdict.code == protos::VALID) {
      ++counts_.valid;
    } else {
      ++counts_.invalid[verdict.code];
    }
  }
  if (!orderers_ || orderers_->config_block_number() != next_) return;
  ++counts_.config_blocks;
  if (next_ == 0) return;  // the anchor, or taken as it is: done before
  if (const auto read = fabric::read_channel_config(block); read) configure(*read);
}

/// The peer's word against our own.
void ChainAudit::compare(const common::Block& block, const std::vector<fabric::TransactionVerdict>& verdicts) {
  const std::string& flags = metadata(block, common::TRANSACTIONS_FILTER);
  if (flags.empty()) {
    ++counts_.without_flags;
    return;
  }
  for (std::size_t i = 0; i < verdicts.size() && i < flags.size(); ++i) {
    const int flag = static_cast<unsigned char>(flags[i]);
    const fabric::TransactionVerdict& verdict = verdicts[i];
    if (flag == verdict.code) continue;
    add_finding(i, verdict.tx_id,
                fmt::format("its flag is {}, but it is {}{}{}", code_name(flag), code_name(verdict.code),
                            *verdict.why == '\0' ? "" : ": ", verdict.why));
  }
}

void ChainAudit::add_to_report(const fabric::Block& block, const std::vector<fabric::TransactionVerdict>& verdicts) {
  for (std::size_t i = 0; i < verdicts.size() && i < block.transactions.size(); ++i) {
    const fabric::Transaction& tx = block.transactions[i];
    counts_.endorsements += tx.endorsements.size();
    if (tx.code == fabric::code_unverified)
      add_finding(i, tx.tx_id, fmt::format("it is flagged VALID and cannot be trusted: {}", tx.problem));
    if (tx.config) continue;
    const auto member = members_->member(tx.creator, std::nullopt);
    const access::Caller creator = member ? access::Caller{(*member)->name, (*member)->admin}
                                          : access::Caller{{"", "nobody of the channel"}, false};
    const Status status = report_->add({block.number, i, verdicts[i].code, verdicts[i].why}, tx, creator);
    if (!status) add_finding(i, tx.tx_id, status.error().message);
  }
}

}  // namespace ledgerline::audit
