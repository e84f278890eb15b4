#include "hil/fault/real/live_facts.hpp"

#include <sys/stat.h>

#include <utility>

#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {

namespace {

// For triggers: there is no link to say it.
FlightPhase phase_by_truth(const DroneFacts& drone) {
  if (on_course(drone.truth)) return FlightPhase::flying;
  if (!on_ground(drone.truth)) return drone.phase;
  return in_flight(drone.phase) || drone.phase == FlightPhase::landed ? FlightPhase::landed : FlightPhase::on_ground;
}

}  // namespace

std::vector<TraceRecord> GrowingTrace::read_new() {
  struct stat file {};
  if (::stat(path_.c_str(), &file) != 0) return {};
  if (!reader_ || file.st_ino != inode_) {
    auto opened = TraceReader::open(path_);
    if (!opened) return {};
    reader_ = std::make_unique<TraceReader>(std::move(*opened));
    inode_ = file.st_ino;
  }
  auto records = reader_->read_new();
  return records ? std::move(*records) : std::vector<TraceRecord>{};
}

LiveFacts::LiveFacts(const std::string& run, const Script& script)
    : sim_(run + "/sim.trace"),
      link_(run + "/link.trace"),
      ground_(run + "/ground.trace"),
      by_sdk_(script.kind == FlightKind::sdk),
      facts_(static_cast<std::size_t>(script.flight.drones)) {
  for (std::size_t i = 0; i < facts_.size(); ++i) {
    facts_[i].name = drone_name(static_cast<int>(i) + 1);
    lap_m_.push_back(course_of(script.flight, static_cast<int>(i) + 1, {}).length_m());
  }
}

void LiveFacts::read() {
  for (const TraceRecord& r : sim_.read_new()) {
    if (by_sdk_ && begin_ns_ == 0) begin_ns_ = r.t_ns;
    if (DroneFacts* drone = of(r); drone && r.kind == TraceKind::truth) {
      drone->truth.in_flight = r.extra == 1;
      drone->truth.position_m = {r.v[0], r.v[1], r.v[2]};
      if (by_sdk_) drone->phase = phase_by_truth(*drone);
    }
  }
  for (const TraceRecord& r : link_.read_new()) {
    if (begin_ns_ == 0) begin_ns_ = r.t_ns;
    if (DroneFacts* drone = of(r); drone && r.kind == TraceKind::mode) drone->phase = static_cast<FlightPhase>(r.id);
  }
  for (const TraceRecord& r : ground_.read_new()) {
    DroneFacts* drone = of(r);
    if (!drone || r.kind != TraceKind::command_made || r.v[3] <= 0) continue;
    drone->ground_phase = ground::DronePhase::path;
    drone->lap = 1 + static_cast<int>(r.v[3] / lap_m_[r.drone - 1u]);
  }
}

}  // namespace ledgerline::hil
