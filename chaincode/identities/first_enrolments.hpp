#pragma once
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"

namespace ledgerline {

/// Who comes with a new ledger of our own, embedded or Fabric: Org1's User1 is the host of tello1 to tello16, Org2's
/// User1 an operator. Each is enrolled by its organisation's administrator.
struct FirstEnrolment {
  int organisation;
  std::vector<std::string> drones;
  bool is_operator;
  /// The argument of `enroll` (EnrollCall).
  std::string call(const crypto::IdentityName& user) const;
};
std::vector<FirstEnrolment> first_enrolments();

}  // namespace ledgerline
