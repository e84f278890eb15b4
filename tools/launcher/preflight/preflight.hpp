#pragma once
#include <array>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "tools/launcher/options.hpp"

namespace ledgerline::fly {

/// What a person checks before a deployment's own drones take off, by link's status lines. One thread.
class Preflight {
 public:
  /// Without drones of one's own it knows of none.
  explicit Preflight(const Options& options);

  /// A status line of link; others are ignored.
  void take(const std::string& line);
  /// Link would let every drone take off.
  bool ready() const;
  /// Drones, addresses, batteries, poses and the fence, one a line.
  std::string list() const;
  /// Each drone that could not take off and why, for an error; empty: ready.
  std::string missing() const;
  /// Whether the path stays within the fence from where the drones stand.
  Status path_fits() const;

 private:
  struct Drone {
    std::string phase = "disconnected", cause;
    double battery = 0;
    double pose_age_ms = -1;  ///< < 0: none has come
    std::array<double, 3> position_m{};
    bool there() const { return phase != "disconnected"; }
  };
  const deployment::OwnDrone& own(std::size_t i) const { return options_.own->drones[i]; }
  bool ready(const Drone& drone) const;
  std::string why_not(std::size_t i) const;

  Options options_;
  std::vector<Drone> drones_;  ///< in the order of the file
};

}  // namespace ledgerline::fly
