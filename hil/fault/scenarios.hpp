#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"

/// Scripts as files: those that come with the program, those that a person names, and one to begin with.
namespace ledgerline::hil {

/// Folder of the scenarios that come with a program of `prefix`: share/ledgerline/scenarios, where they are
/// installed, else hil/scenarios of the source tree that the program was built in. The error says where was looked.
Result<std::string> scenario_folder(const std::string& prefix);

/// All *.toml in it and below, sorted; the error says that there is none.
Result<std::vector<std::string>> scripts_in(const std::string& folder);

/// The files that a person means: each name is a file, a folder, a scenario or group of scenarios that comes with the
/// program, or `all` of those. Sorted, each once.
Result<std::vector<std::string>> scripts_named(const std::vector<std::string>& names, const std::string& prefix);

/// Name of a scenario, and group: the folder that it lies in, below the one that was looked into.
std::string name_of_script(const std::string& file);
std::string group_of(const std::string& file, const std::string& folder);

/// A script to begin with, for a file of this name: every part with a word on it, ready to fly; it holds.
std::string first_script(const std::string& name);

}  // namespace ledgerline::hil
