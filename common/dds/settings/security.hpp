#pragma once
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"

/// What DDS Security wants from an organisation's authority, so that outsiders on the LAN can neither read nor send.
namespace ledgerline::dds {

struct SecurityDocuments {
  std::string identity_ca;  ///< PEM: the authority, as it signs documents
  std::string governance;   ///< S/MIME: every topic of domains 0 to 230 is encrypted, joining needs a certificate
  std::string permissions;  ///< S/MIME: who may write what; all members may read every topic
};

/// Certificates in PEM that the authority has issued (P-256). Who is in two lists may write what either may.
struct SecurityMembers {
  std::vector<std::string> programs{};  ///< ground, agents, bridges: every topic but pilots' and poses
  std::vector<std::string> pilots{};    ///< pilots' topics, and what a ROS 2 node of any kind has
  std::vector<std::string> trackers{};  ///< motion capture: poses, and the same
  /// Of the topics with poses ("/vrpn_mocap/tello1/pose", as [mocap] topic of agent.toml says); * stands for anything.
  std::string poses = "/vrpn_mocap/*";
};

/// Permissions end with the authority's certificate; a new member needs new permissions, the others keep theirs.
Result<SecurityDocuments> make_security_documents(const crypto::KeyAndCertificate& authority,
                                                  const SecurityMembers& members);

}  // namespace ledgerline::dds
