#pragma once
#include <string>

#include "common/config/config.hpp"
#include "common/dds/dds.hpp"

namespace ledgerline::dds {

/// Reads [dds] of a program's config: domain; local_only, interfaces and peers, or cyclonedds (may be missing);
/// ros_release; and the files of DDS Security: identity_ca, certificate, private_key, governance, permissions (all of
/// them or none). What is wrong comes with config.finish().
ParticipantOptions participant_options(Config& config, const std::string& node);

/// The same of a TOML file that has nothing but [dds]; no name: as if [dds] were empty.
Result<ParticipantOptions> participant_options_of(const std::string& file, const std::string& node);

}  // namespace ledgerline::dds
