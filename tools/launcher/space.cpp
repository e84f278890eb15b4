#include "tools/launcher/space.hpp"

#include <algorithm>

#include "tools/launcher/configs.hpp"

namespace ledgerline::fly {
namespace {

// Measured at 30 states a second and blocks of one transaction, with 1 and 16 drones (docs/fabric.md, docs/fly.md):
// what every second costs, and what each drone adds. Most of it is certificates and signatures, a set for each
// transaction.
struct Growth {
  double second, drone_second;
};
constexpr Growth embedded{0.27e6, 0.13e6}, fabric{0.84e6, 0.34e6}, each_orderer{0.26e6, 0.09e6};
// Fabric's orderers make files of 64 MB beforehand, and keep some of them; the embedded node starts with nothing.
constexpr double fabric_fixed = 50e6, orderer_fixed = 400e6;
constexpr double rate_measured_hz = 30, margin = 1.5;

}  // namespace

double expected_seconds(const Options& options) {
  constexpr double up_and_down_s = 20, corner_s = 2;
  constexpr double manual_s = 600;  // lasts as long as the pilot likes
  if (options.seconds > 0) return options.seconds + up_and_down_s;
  if (options.manual) return manual_s;
  const ground::Path path = path_of(options, {0, 0});
  const double lap_s = path.length_m() / (options.ramp.start_mps > 0 ? options.ramp.start_mps : options.speed_mps) +
                       corner_s * static_cast<double>(path.corners().size());
  return options.laps * lap_s + up_and_down_s;
}

std::uint64_t expected_ledger_bytes(const Options& options) {
  if (options.ledger == "none") return 0;
  const bool real = options.ledger == "fabric";
  const double orderers = real ? options.orderers : 0;
  const Growth& base = real ? fabric : embedded;
  const double each_s = base.second + orderers * each_orderer.second +
                        options.drones * (base.drone_second + orderers * each_orderer.drone_second);
  const double fixed = real ? fabric_fixed + orderers * orderer_fixed : 0;
  const double rate = std::max(1.0, options.rate_hz / rate_measured_hz);
  return static_cast<std::uint64_t>(fixed + margin * rate * each_s * expected_seconds(options));
}

}  // namespace ledgerline::fly
