#pragma once
#include "tools/audit/story/story.hpp"

namespace ledgerline::audit {

/// One asset of a drone, as its host's agent writes them: its pose, what link did, its failsafe's transitions. What is
/// malformed or of another type says nothing of the drone.
void take_asset(const Asset& asset, const Moment& when, DroneStory& story);

}  // namespace ledgerline::audit
