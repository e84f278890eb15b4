#pragma once
#include <string>

namespace ledgerline::hil {

/// A script to begin with, for a file of this name: every part with a word on it, ready to fly; it holds.
std::string first_script(const std::string& name);

}  // namespace ledgerline::hil
