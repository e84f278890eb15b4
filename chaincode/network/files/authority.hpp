#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/options.hpp"
#include "common/base/result.hpp"

/// Identities from fabric-ca: one server an organisation (0: the orderers'), each below DIR/ca, which nobody else may
/// enter. Its CA signs identities and, by its profile `tls`, TLS certificates, so CA and TLS CA are the same in the
/// layout.
///
///     server starts -> registrar enrols -> registers each member with a random secret -> each member enrols
///
/// The secrets are spent and forgotten; the registrar's identity stays, for revocations.
namespace ledgerline::network {

struct Authorities {
  std::string dir, tools;                ///< of the network, and the folder with fabric-ca's programs
  std::vector<ListenAddress> addresses;  ///< the orderers' first
};

/// Of the fabric-ca of each organisation.
Authorities authorities(const Options& options, const ListenAddresses& addresses);

/// DIR has authorities: a network begun with them goes on with them.
bool has_authorities(const std::string& dir);

/// "ca1" to "ca3", and "ca0" of the orderers: the names of processes.
std::string authority_name(int organisation);

/// Writes the servers' configurations and the registrars' secrets, where they are missing. An issuing that a crash
/// interrupted starts again. An error: a program is missing.
Status prepare_authorities(const Authorities& authorities);
/// A server's command and environment.
std::vector<std::string> authority_command(const Authorities& authorities);
std::vector<std::string> authority_environment(const Authorities& authorities, int organisation);
/// It takes connections.
bool authority_listens(const Authorities& authorities, int organisation);

/// What identities::make asks for, from the running servers.
Result<std::vector<identities::IssuedCertificates>> issue_by_authorities(
    const Authorities& authorities, const std::vector<std::vector<identities::CertificateSpec>>& wanted);

/// What is to be revoked: one of the two.
struct Revoked {
  std::string user{};             ///< "User1", "endorser0": all certificates that it has
  std::string certificate_pem{};  ///< this one alone: its owner goes on with a renewed one
};
/// Revokes at the running server, and what its revocation list (PEM) then is. Again for what is revoked already: just
/// the list. An error: the list does not name the certificate.
Result<std::string> revoke_at_authority(const Authorities& authorities, int organisation, const Revoked& revoked);

/// An update of a channel's configuration that makes `list` (PEM) the one of its authority in an organisation's MSP,
/// beside those of the organisation's other authorities: a common.Envelope that nobody has signed yet. An error: the
/// authority's list in force is newer. `config_block`: common.Block with the configuration in force. Pure.
Result<std::string> revocation_update(std::string_view config_block, const std::string& msp_id,
                                      const std::string& list);
/// The configuration in `config_block` has `list` for this MSP already.
Result<bool> has_revocation_list(std::string_view config_block, const std::string& msp_id, const std::string& list);

/// Puts `list` into the configuration of each of `options.channels` of a running network, in the name of the
/// organisation's administrator, whose signature suffices for its own MSP. Returns when every peer knows. May be
/// repeated.
Status publish_list(const Options& options, const ListenAddresses& addresses, int organisation,
                    const std::string& list);
/// A file with a revocation list (PEM) that the organisation's authority has signed.
Result<std::string> read_list(const Options& options, int organisation, const std::string& file);

/// Revokes a user ("User1"), or the organisation's "endorser0", of a running network, or one certificate of any of
/// them: at its fabric-ca, then by publish_list(). From then on peers refuse it, and what it endorses is invalid; what
/// stands on the ledger stays. An error: what is not looked up in lists, or what the organisation's administrator signs
/// with.
Status revoke(const Options& options, const ListenAddresses& addresses, int organisation, const Revoked& revoked);

}  // namespace ledgerline::network
