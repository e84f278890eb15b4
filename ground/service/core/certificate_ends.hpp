#pragma once
#include <map>
#include <string>
#include <vector>

#include "common/crypto/identities/renewal.hpp"
#include "common/fabric/tx/transaction.hpp"

namespace ledgerline::ground::service {

/// Whose certificates near their end among those that write drones' states: agents, whose hosts nobody may look at.
/// Read from the blocks, so an agent of any make is seen. Deterministic; one thread.
class CertificateEnds {
 public:
  static constexpr std::size_t max_writers = 256;  ///< beyond it new ones are not looked at

  void note(const fabric::Block& block);
  /// What is to be reported now (crypto::Renewal::look).
  std::vector<crypto::Renewal::Notice> look(std::int64_t now_s);

 private:
  struct Writer {
    std::string serialized;  ///< msp.SerializedIdentity
    std::int64_t not_before_s = 0, not_after_s = 0;
    crypto::Renewal renewal;
  };
  std::map<crypto::IdentityName, Writer> writers_;
};

}  // namespace ledgerline::ground::service
