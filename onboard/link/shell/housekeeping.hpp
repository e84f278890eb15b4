#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <utility>

#include "common/program/service_manager.hpp"
#include "common/rt/trace.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/link/shell/link_loop.hpp"
#include "onboard/link/shell/persistent_state.hpp"
#include "onboard/link/shell/transport/link_ends.hpp"

namespace ledgerline::link {

/// What the thread beside the loop does, which may block: log, status lines, trace file, the file of local stops, RouDi
/// and the network's addresses. What it refers to must outlive it. One thread.
class Housekeeping {
 public:
  Housekeeping(const ShellSettings& settings, LinkLoop& loop, std::optional<TraceWriter> trace,
               const WatchdogThread& watchdog, LocalStopsFile& stops, LinkEnds& ends)
      : settings_(settings), loop_(loop), trace_(std::move(trace)), watchdog_(watchdog), stops_(stops), ends_(ends) {}

  /// A turn, every few milliseconds.
  void once(TimeNs now);
  /// RouDi is not the one that link is connected to any more, and nothing flies: only a new start connects it again.
  bool must_restart() const;
  /// Writes the rest of the trace.
  Status close();

 private:
  void log_mode(const TraceRecord& record) const;
  void log_warnings(const StateSample& before, const StateSample& now) const;
  void log_serial(const SerialReport& reported) const;
  void log_words(const DroneWords& said) const;
  /// The loop speaks of no others.
  const DroneSettings& drone(DroneNumber number) const;
  void store_stops(TimeNs now);
  void watch_roudi(TimeNs now);

  const ShellSettings& settings_;
  LinkLoop& loop_;
  std::optional<TraceWriter> trace_;
  const WatchdogThread& watchdog_;
  std::uint64_t watchdog_failed_ = 0;
  LocalStopsFile& stops_;
  LinkEnds& ends_;
  DroneSet reported_stops_;
  TimeNs next_stops_ns_ = 0;
  std::array<StateSample, max_drones + 1> newest_{};
  std::array<std::optional<SerialReport>, max_drones + 1> serials_{};
  TimeNs next_status_ns_ = 0;
  TimeNs next_roudi_ns_ = 0;
  TimeNs next_refresh_ns_ = 0;
  bool roudi_lives_ = true;
};

}  // namespace ledgerline::link
