#pragma once
#include <memory>
#include <mutex>
#include <utility>

#include "common/crypto/crypto.hpp"

namespace ledgerline::crypto {

/// The identity that a program signs with now. A signer takes the whole of it once a transaction and keeps it until
/// that has ended, so certificate and signature are always of one pair. Any thread.
class IdentityInUse {
 public:
  explicit IdentityInUse(SigningIdentity first) { replace(std::move(first)); }

  std::shared_ptr<const SigningIdentity> now() const {
    const std::lock_guard lock(mutex_);
    return now_;
  }
  void replace(SigningIdentity next) {
    auto whole = std::make_shared<const SigningIdentity>(std::move(next));
    const std::lock_guard lock(mutex_);
    now_.swap(whole);
  }

 private:
  mutable std::mutex mutex_;
  std::shared_ptr<const SigningIdentity> now_;
};

}  // namespace ledgerline::crypto
