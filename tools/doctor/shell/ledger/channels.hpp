#pragma once
#include <vector>

#include "common/config/config.hpp"
#include "common/fabric/client/client.hpp"
#include "tools/doctor/shell/configs.hpp"

namespace ledgerline::doctor {

/// A program's config once for each channel that it is on, with the keys and the drones of that channel; the file's
/// name says which, where there are several.
std::vector<ProgramConfig> of_each_channel(const ProgramConfig& one);

/// The client's config of that channel, as the program makes it.
Result<fabric::ClientConfig> client_of_channel(Config& config, const ProgramConfig& one);

/// That client, at another peer alone: with its TLS pair where it has one of its own.
fabric::ClientConfig client_at(const ServerKeys& peer, fabric::ClientConfig client);

}  // namespace ledgerline::doctor
