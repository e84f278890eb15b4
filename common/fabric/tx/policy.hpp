#pragma once
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

/// Signature policies: common.SignaturePolicyEnvelope, as peers validate endorsements, and orderers' signatures. Pure.
namespace ledgerline::fabric {

/// The name under which Fabric keeps a key's policy among its metadata.
inline constexpr const char* validation_parameter = "VALIDATION_PARAMETER";

/// Who has signed.
struct PolicySigner {
  std::string msp_id;
  bool peer = false;     ///< OU=peer
  bool orderer = false;  ///< OU=orderer
  /// Who it is, for those who compare identities: MSP id and certificate. Empty: nobody asks.
  std::string identity{};
  bool operator==(const PolicySigner&) const = default;
};

/// "A peer of this organisation", and "a member", serialized.
std::string peer_policy(const std::string& msp_id);
std::string member_policy(const std::string& msp_id);

/// Whether these endorsements, each of another identity, satisfy a serialized policy. As Fabric's: each counts once in
/// a policy. One that does not parse, or asks for anything but members, peers, orderers and numbers of them, is
/// satisfied by nobody.
bool satisfies(std::string_view policy, const std::vector<PolicySigner>& endorsers);

/// A policy of a channel: so many of these signature policies must be satisfied, each by the identities that have
/// signed. One signature policy by itself, or what an ImplicitMetaPolicy makes of those of its organisations.
struct Policy {
  std::vector<std::string> parts;  ///< each a serialized common.SignaturePolicyEnvelope
  std::size_t needed = 1;
};
bool satisfies(const Policy& policy, const std::vector<PolicySigner>& endorsers);
/// One that nobody can satisfy.
inline Policy unsatisfiable_policy() { return {{}, 1}; }

}  // namespace ledgerline::fabric
