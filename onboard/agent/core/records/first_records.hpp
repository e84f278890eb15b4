#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/verification/roles.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::agent {

/// Who may do what with which drone, at one block of the chain: the blocks change it from then on.
struct FirstRecords {
  std::vector<Control> controls;
  verification::Roles roles;
};

/// For a checkpoint: Assets as the ledger's own `get` would answer, so that nothing new has to be read back.
std::string to_bytes(const FirstRecords& records);
/// An error: they are malformed, or one of the drones has no record among them.
Result<FirstRecords> records_from(std::string_view bytes, const std::vector<std::string>& drones);

}  // namespace ledgerline::agent
