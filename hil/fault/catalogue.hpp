#pragma once
#include <string>
#include <utility>
#include <vector>

#include "hil/fault/kinds/fault.hpp"

// What there is for scripts: in which modes each kind of fault can be had, asked of the kinds themselves with an
// example of each; and a script's schema.
namespace ledgerline::hil {

/// Whether a word of a form stands for something: it is in capitals.
bool is_placeholder(std::string_view word);

/// Faults of this kind, one for each way to choose among its words, with something sensible for its words in capitals:
/// "agent kill", "link kill", "ground kill". A script's fault takes each of them, or says why not. Empty: the form has
/// a word in capitals that nobody has given an example for (catalogue.cpp).
std::vector<std::string> examples_of(const FaultKind& kind);

/// How the examples of a kind fare in one mode.
struct InMode {
  std::vector<std::string> possible;
  std::vector<std::pair<std::string, std::string>> refused;  ///< and why
  bool all() const { return refused.empty() && !possible.empty(); }
};
struct KindModes {
  const FaultKind* kind = nullptr;
  InMode sitl, embedded, fabric;  ///< the latter two: with the real processes, on this ledger
  InMode shim;                    ///< with the real processes, and drones behind the shim
};
KindModes modes_of(const FaultKind& kind);

/// "sitl, real", "real: `agent kill`", "refused: why" ...: the modes in words.
std::string modes_text(const KindModes& modes);

/// JSON Schema (draft 7) of a fault script, for editors and other programs: its keys as the reader of scripts asks for
/// them, its faults, moments and rules as their tables have them. A script that parse_script() takes is valid; one that
/// is valid may still be wrong in what no schema can say, such as a drone that does not fly.
std::string script_schema();

}  // namespace ledgerline::hil
