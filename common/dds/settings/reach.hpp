#pragma once
#include <optional>
#include <string>
#include <string_view>

#include "common/dds/dds.hpp"

namespace ledgerline::dds {

/// How far a participant's domain reaches. Pure.
struct Reach {
  /// Of Cyclone, in place of CYCLONEDDS_URI; none: Cyclone looks for itself, at the environment, too.
  std::optional<std::string> cyclone_config;
  std::string warning;  ///< empty: nothing that a person would not expect
};

/// The config beats the environment. `uri`: CYCLONEDDS_URI, empty where it is not set.
Reach reach_of(const ParticipantOptions& options, std::string_view uri);

}  // namespace ledgerline::dds
