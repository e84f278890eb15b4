#pragma once
#include <string>
#include <string_view>

#include "chaincode/network/files/authority.hpp"
#include "chaincode/network/options.hpp"
#include "common/base/result.hpp"

namespace ledgerline::fabric_network {

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
Status publish_list(const Options& options, const ListenAddresses& places, int organisation, const std::string& list);
/// A file with a revocation list (PEM) that the organisation's authority has signed.
Result<std::string> read_list(const Options& options, int organisation, const std::string& file);

/// Revokes a user ("User1"), or the organisation's "endorser0", of a running network, or one certificate of any of
/// them: at its fabric-ca, then by publish_list(). From then on peers refuse it, and what it endorses is invalid; what
/// stands on the ledger stays. An error: what is not looked up in lists, or what the organisation's administrator signs
/// with.
Status revoke(const Options& options, const ListenAddresses& places, int organisation, const Revoked& revoked);

}  // namespace ledgerline::fabric_network
