#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "tools/audit/chain_audit.hpp"

namespace ledgerline::audit {

/// What was audited, beside what was found.
struct AuditRequest {
  std::string channel, source;
  std::string anchor;  ///< file; empty: the first block was taken as it is
};

/// For a terminal: one or two screens. The last line names the first finding, or says that there is none.
std::string to_table(const ChainAudit& audit, const AuditRequest& asked);
/// The object of --json. Times are in seconds since 1970, as clients claimed them.
nlohmann::json to_json(const ChainAudit& audit, const AuditRequest& asked);
/// The page, from that object. Self-contained.
std::string to_page(nlohmann::json document);

}  // namespace ledgerline::audit
