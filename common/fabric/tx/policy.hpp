#pragma once
#include <string>
#include <string_view>
#include <vector>

/// Endorsement policies: common.SignaturePolicyEnvelope, as peers judge them. Pure.
namespace ledgerline::fabric {

/// Who has endorsed, or whom a principal asks for.
struct Endorser {
  std::string msp_id;
  bool peer = false;  ///< OU=peer
};

/// "A peer of this organisation", serialized.
std::string peer_policy(const std::string& msp_id);

/// Whether these endorsements, each of another identity, satisfy a serialized policy. As Fabric's: each counts once in a
/// policy. One that does not parse, or asks for anything but members, peers and numbers of them, is satisfied by nobody.
bool satisfies(std::string_view policy, const std::vector<Endorser>& endorsers);

}  // namespace ledgerline::fabric
