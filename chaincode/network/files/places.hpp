#pragma once
#include <string>
#include <vector>

#include "chaincode/network/options.hpp"
#include "common/base/result.hpp"

namespace ledgerline::fabric_network {

// Where the parts of a network listen. That is in the channels' first blocks and in packages, so a directory keeps it.

/// Those that the directory keeps; the first time those of the options, or free ports of this host, which are then
/// kept. An error: the directory is of a network with others.
Result<ListenAddresses> choose_places(const Options& options);

/// An error names the first one that cannot be listened on, and why.
Status check_free(const std::vector<ListenAddress>& places);

// Each host's own part of a network that was prepared in one place.

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
