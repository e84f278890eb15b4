#pragma once
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"

/// What DDS Security wants from an organisation's authority, so that outsiders on the LAN can neither read nor send.
namespace ledgerline::dds {

struct SecurityDocuments {
  std::string identity_ca;  ///< PEM: the authority, as it signs documents
  std::string governance;   ///< S/MIME: every topic of domains 0 to 230 is encrypted, joining needs a certificate
  std::string permissions;  ///< S/MIME: the members may read and write every topic
};

/// `members`: certificates in PEM that the authority has issued (P-256). Permissions end with the authority's
/// certificate; a new member needs new permissions, the others keep theirs.
Result<SecurityDocuments> make_security_documents(const crypto::KeyAndCertificate& authority,
                                                  const std::vector<std::string>& members);

}  // namespace ledgerline::dds
