#pragma once
#include <string>

#include "common/config/config.hpp"
#include "hil/sitl/world_setup.hpp"

// What a script's drones fly, in [flight] and [[task]], and the same as text again.
namespace ledgerline::hil {

/// Reads `shape` (a name, or a CSV file beside the script), `waypoints` (in the place of both: "x,y[,z[,speed]]" each),
/// `side_m`, `speed_mps` and `laps` below `prefix` ("flight."); what is not there stays as it is in `task`. `folder`:
/// of the script.
void read_course(Config& config, const std::string& prefix, const std::string& folder, ground::Task& task);
/// [flight]'s own course, then each [[task]]: `drone`, and the same keys. After the number of drones.
void read_tasks(Config& config, const std::string& folder, WorldConfig& flight);

/// The keys that differ from `usual`, a line each.
std::string course_text(const ground::Task& task, const ground::Task& usual);
/// Its waypoints as rows of a CSV file.
std::string course_rows(const ground::Task& task);
/// Each [[task]].
std::string tasks_text(const WorldConfig& flight);

/// The greatest height that is flown at.
double greatest_height_m(const WorldConfig& flight);

}  // namespace ledgerline::hil
