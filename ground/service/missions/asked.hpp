#pragma once
#include <optional>
#include <string>

#include "common/crypto/crypto.hpp"

namespace ledgerline::ground::service {

/// What a client asks of the station's missions.
struct MissionAsk {
  enum class Kind { list, show, add, approve, withdraw, start, pause, resume, land, remove };
  Kind kind = Kind::list;
  std::string id;                            ///< of all but list and add
  std::string text;                          ///< of add
  bool csv = false;                          ///< of add: CSV, else JSON
  std::string name;                          ///< of add, CSV: the mission's
  std::optional<std::size_t> who{};          ///< index of the operator who asks; none: ground's own identity signs
  std::optional<crypto::IdentityName> by{};  ///< likewise
};

}  // namespace ledgerline::ground::service
