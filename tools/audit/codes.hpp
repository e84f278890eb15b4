#pragma once
#include <fmt/format.h>

#include <string>

#include "peer/transaction.pb.h"

namespace ledgerline::audit {

/// "MVCC_READ_CONFLICT"; a number that Fabric has no name for: itself.
inline std::string code_name(int code) {
  const std::string& name = protos::TxValidationCode_Name(static_cast<protos::TxValidationCode>(code));
  return name.empty() ? fmt::format("code {}", code) : name;
}

}  // namespace ledgerline::audit
