#pragma once
#include <functional>

#include "common/program/command_line.hpp"

// The verbs of `ledgerline fault`, a file each. A new one: its function here, and in main.cpp's row of them.
namespace ledgerline::hil::verbs {

/// A verb with its options, and what it does once the command line is read: the exit code is what it returns. The
/// options live as long as `act`.
struct Act {
  Verb verb;
  std::function<int()> act;
};

/// 1: a rule broke, a regression was found, or a file could not be written. 2 is exit_usage
/// (common/program/program.hpp).
inline constexpr int exit_broken = 1;

Act run(CommandLine& line);
Act random(CommandLine& line);
Act list(CommandLine& line);
Act check(CommandLine& line);
Act make_new(CommandLine& line);
Act compare(CommandLine& line);
Act schema(CommandLine& line);

}  // namespace ledgerline::hil::verbs
