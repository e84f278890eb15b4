#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "onboard/link/core/settings.hpp"
#include "tools/launcher/options.hpp"

namespace ledgerline::fly {

/// Where the simulator puts its drones, m in `map`.
std::vector<Eigen::Vector2d> simulated_starts(const Options& options);

/// The path's first point that a drone would not reach, from where each one starts; empty: none.
std::string beyond_fence(const Options& options, const link::FenceSettings& fence,
                         const std::vector<Eigen::Vector2d>& starts);

}  // namespace ledgerline::fly
