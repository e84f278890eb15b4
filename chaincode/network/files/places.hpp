#pragma once
#include <vector>

#include "chaincode/network/options.hpp"
#include "common/base/result.hpp"

/// Where the parts of a network listen. That is in the channels' first blocks and in packages, so a directory keeps it.
namespace ledgerline::fabric_network {

/// Those that the directory keeps; the first time those of the options, or free ports of this host, which are then
/// kept. An error: the directory is of a network with others.
Result<ListenAddresses> choose_places(const Options& options);

/// An error names the first one that cannot be listened on, and why.
Status check_free(const std::vector<ListenAddress>& places);

}  // namespace ledgerline::fabric_network
