#pragma once
#include <string>
#include <vector>

#include "chaincode/network/files/authority.hpp"
#include "chaincode/network/options.hpp"

/// What Fabric's programs read: pure functions of the options.
namespace ledgerline::fabric_network {

/// Of the fabric-ca of each organisation.
Authorities authorities(const Options& options, const ListenAddresses& places);

/// configtx.yaml with the profile `Ledgerline`.
std::string configtx_yaml(const Options& options, const ListenAddresses& places);

/// "NAME=value" for an orderer, a peer, and the `peer` command line in the name of an organisation's administrator.
std::vector<std::string> orderer_environment(const Options& options, const ListenAddresses& places, int number);
std::vector<std::string> peer_environment(const Options& options, const ListenAddresses& places, int organisation);
std::vector<std::string> admin_environment(const Options& options, const ListenAddresses& places, int organisation);
/// Of an organisation's chaincode service, whose package has this id.
std::vector<std::string> chaincode_environment(const Options& options, const ListenAddresses& places, int organisation,
                                               const std::string& package_id);

/// connection.json of an organisation's chaincode package: mutual TLS, without the peer's pair, which builder_script's
/// release adds. An administrator of the organisation can fetch a package, and archives get copied around.
std::string connection_json(const ListenAddresses& places, int organisation, const std::string& ca_pem);

/// The peers' external builder for chaincode as a service: the programs detect, build and release. They read the peer's
/// TLS pair where its environment says.
std::string builder_script(const std::string& name);

}  // namespace ledgerline::fabric_network
