#pragma once
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"

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

}  // namespace ledgerline::fabric
