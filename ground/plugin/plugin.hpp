#pragma once
#include <string>

#include "ground/core/follower.hpp"

namespace ledgerline::ground {

/// Loads a shared library that is a controller (ground/plugin/controller_plugin.h). What is returned makes a follower
/// of it for each drone, from any thread, and holds the library. Errors name the file: it cannot be loaded, is no
/// controller, is one of another version, lacks a function.
///
/// A follower made so checks whatever the plug-in says: a plan with a number that is not finite or beyond absurd_speed,
/// with setpoints out of order or beyond what was asked for, with none or too many, or a progress that is none is not
/// sent; check() then says what was wrong, and the drone is landed. An exception that gets out is such a problem too.
/// What no process survives (a wild pointer) still ends ground: link then lands the drones.
Result<MakeFollower> load_controller(const std::string& file);

}  // namespace ledgerline::ground
