#pragma once
#include <string>
#include <vector>

#include "common/fabric/tx/policy.hpp"
#include "tools/doctor/core/finding.hpp"

/// Whether the peers that sign for a program are those whose signatures its calls need. Pure.
namespace ledgerline::doctor {

/// A peer that was asked to sign a call.
struct EndorsingPeer {
  std::string msp_id;              ///< who it is, by its signature; where it has not signed: who it is said to be
  std::string place;               ///< "[[endorser]] 10.0.0.2:7061", "the gateway"
  std::string why{};               ///< it has not signed; empty: it has
  std::string said_to_be{msp_id};  ///< by the config
  std::string identity{place};     ///< of two with the same one counts
};

struct EndorsementFacts {
  std::string program;  ///< "ground.toml"
  std::string what;     ///< that must be endorsed: "new records of contract ledgerline"
  fabric::Policy policy;
  std::vector<std::string> organisations;  ///< of the channel
  std::vector<EndorsingPeer> peers{};
  bool by_gateway = false;  ///< it finds the peers; else the config names them
};
Finding assess(const EndorsementFacts& facts);

}  // namespace ledgerline::doctor
