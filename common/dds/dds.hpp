#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/config/config.hpp"
#include "common/crypto/crypto.hpp"
#include "common/dds/raw.hpp"

/// ROS 2 over Cyclone DDS: names, types and QoS are those of a ROS 2 node, so a ROS 2 machine sees them. Topics are
/// given as in ROS ("/tello1/odom"); on the wire they are "rt/tello1/odom". No type of DDS is visible here.
namespace ledgerline::dds {

class NodeInfo;

/// Files of DDS Security, which make_security_documents() makes from an organisation's authority.
struct Security {
  std::string identity_ca;               ///< PEM; signed the documents, too
  std::string certificate, private_key;  ///< PEM; a key that others may read is refused
  std::string governance, permissions;   ///< S/MIME
};

struct ParticipantOptions {
  /// True: loopback only, discovery included, whatever CYCLONEDDS_URI says; works whether or not lo can multicast.
  /// False: the machine may be left. Not said: loopback, unless CYCLONEDDS_URI is set, which then decides. Where the
  /// environment is overruled or decides, the log warns.
  std::optional<bool> local_only{};
  /// Names of the interfaces to use, four at most, and hosts to look for by unicast. Where one of the two is given,
  /// they decide; peers alone leave the interfaces to Cyclone.
  std::vector<std::string> interfaces{}, peers{};
  /// Of ROS 2 on this host: "humble", "jazzy" ... It decides the form in which nodes are announced (empty:
  /// ROS_DISTRO's), and which neighbours are met on a domain that stays on this machine: since Iron they may announce
  /// any of its addresses.
  std::string ros_release{};
  /// A file of Cyclone DDS's own configuration, in place of all that; empty: none.
  std::string cyclonedds{};
  /// Else ROS_DOMAIN_ID, else 0. A ROS_DOMAIN_ID that is no number of 0..232 is an error.
  std::optional<std::uint32_t> domain{};
  /// As ROS 2's tools list it, "agent" or "/fleet/agent"; empty: they see topics, but no node.
  std::string node{};
  /// Where it is set, only participants whose certificate is of the same authority are heard and hear this one.
  std::optional<Security> security{};
};

/// A process's place in a DDS domain; one is enough. Thread-safe. Readers and writers keep it alive. The first one of a
/// process decides how its domain is reached: a second for the same domain shares the first one's interfaces.
class Participant {
 public:
  static Result<std::shared_ptr<Participant>> create(const ParticipantOptions& options = {});
  ~Participant();
  Participant(const Participant&) = delete;
  Participant& operator=(const Participant&) = delete;

  int handle() const { return handle_; }
  /// Null where the options name no node.
  NodeInfo* node() const { return node_.get(); }

 private:
  explicit Participant(int handle);
  int handle_;
  std::unique_ptr<NodeInfo> node_;
};

/// Reads [dds] of a program's config: domain; local_only, interfaces and peers, or cyclonedds (may be missing);
/// ros_release; and the files of DDS Security: identity_ca, certificate, private_key, governance, permissions (all of
/// them or none). What is wrong comes with config.finish().
ParticipantOptions participant_options(Config& config, const std::string& node);
/// The same of a TOML file that has nothing but [dds]; no name: as if [dds] were empty.
Result<ParticipantOptions> participant_options_of(const std::string& file, const std::string& node);

/// What DDS Security wants from an organisation's authority, so that outsiders on the LAN can neither read nor send.
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

/// "/a/b" -> "rt/a/b". A name that is empty, relative or has characters that ROS 2 does not allow is an error.
Result<std::string> dds_topic(const std::string& ros_topic);

}  // namespace ledgerline::dds
