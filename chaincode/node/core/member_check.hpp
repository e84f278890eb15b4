#pragma once
#include <memory>
#include <string>
#include <string_view>

#include "chaincode/node/core/types.hpp"
#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// Whether a signature is one of a member of the channel. Copies share the registry. One thread at a time.
class MemberCheck {
 public:
  MemberCheck(std::shared_ptr<crypto::MspRegistry> registry, std::string channel)
      : registry_(std::move(registry)), channel_(std::move(channel)) {}

  /// `signature` of `message` by `serialized` (a msp.SerializedIdentity); the error is in Fabric's words.
  Result<std::shared_ptr<const crypto::MspRegistry::Member>> check(std::string_view serialized,
                                                                   std::string_view message, std::string_view signature,
                                                                   Now now) const;

 private:
  std::shared_ptr<crypto::MspRegistry> registry_;
  std::string channel_;
};

}  // namespace ledgerline::node
