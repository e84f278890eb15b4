#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::fabric_network {

/// A program that is run to its end.
struct Command {
  std::string what;  ///< for errors: "enrolling peer0.org1.ledgerline"
  std::vector<std::string> words;
  std::vector<std::string> environment =
      {};  ///< "NAME=value"; the place for secrets: the words of a process are public
};

/// Runs the commands of each lane one after the other, the lanes side by side. What each lane printed last, by lane;
/// the first failure ends all, with the last lines of its lane's log (`log_stem`-N.log). Each command has a minute.
/// Must be called on the thread that outlives all others (Children).
Result<std::vector<std::string>> run_lanes(const std::vector<std::vector<Command>>& lanes, const std::string& log_stem);

/// One command: what it printed.
Result<std::string> run_command(const Command& command, const std::string& log);

}  // namespace ledgerline::fabric_network
