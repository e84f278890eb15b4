#pragma once
#include <string>
#include <vector>

#include "chaincode/network/options.hpp"

/// Each host's own part of a network that was prepared in one place.
namespace ledgerline::fabric_network {

/// The parts that listen at one address.
struct HostParts {
  std::string host;
  std::vector<int> organisations, orderers;
};
/// By address, in the order of their first mention; empty: the options have no places.
std::vector<HostParts> hosts_of(const Options& options);

/// Copies into `to` what a host needs of the directory `from` that Network::prepare() filled: the private keys of its
/// own organisations' peers, chaincode services and users, and of its own orderers; of all others certificates alone;
/// places and the channels' first blocks. The keys of authorities and of the orderers' administrator stay in `from`.
/// `to` is made under another name and renamed when complete; one that is there already is left as it is.
Status write_host(const std::string& from, const HostParts& parts, const Options& options, const std::string& to);

}  // namespace ledgerline::fabric_network
