#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"
#include "common/rt/result.hpp"

namespace ledgerline {

/// What a trace record is about. Values are part of the file format: only append.
enum class TraceKind : std::uint16_t {
  truth = 1,             ///< sim: id 0, stamp 0, v = x, y, z [m], yaw [rad]; extra = 1 while in flight
  state_sampled = 2,     ///< link: id = state sequence, stamp = its time, v = x, y, z [m], yaw [rad];
                         ///< extra = battery, per mille
  frame_submitted = 3,   ///< agent: id = frame number, extra = samples in it
  frame_committed = 4,   ///< agent: id = frame number, extra = samples in it, stamp = when it was submitted
  state_received = 5,    ///< ground: id = state sequence, stamp = the state's
  command_made = 6,      ///< ground: id = plan sequence, stamp = its state's, v = vx, vy, vz [m/s] of its first
                         ///< setpoint, progress [m]; extra = its action
  command_verified = 7,  ///< agent: id = plan sequence, stamp = its state's; two-way latency = t - stamp
  command_applied =
      8,     ///< link: id = plan sequence, stamp = its state's; age at application = t - stamp; v = setpoint as sent
  mode = 9,  ///< link: id = flight phase, extra = failsafe mode, v[0] = its cause
  refused = 10,    ///< agent or link: id = plan sequence, stamp = its state's, extra = reason
  late_turn = 21,  ///< link: a turn of its loop that began more than a period late; id = its number, stamp = when due
};

/// One fixed 64-byte record of the binary trace, host byte order (little-endian).
struct TraceRecord {
  TimeNs t_ns = 0;  ///< CLOCK_MONOTONIC of the writing host
  TraceKind kind{};
  std::uint16_t drone = 0;  ///< 1 for tello1
  std::uint32_t extra = 0;
  std::uint64_t id = 0;
  TimeNs stamp_ns = 0;
  double v[4] = {};
};
static_assert(sizeof(TraceRecord) == 64);

/// Appends records to a file, buffered; bounded: after `max_records` further ones are only counted, and close() says
/// so. One thread. A real-time loop does not call it: it hands records over through an SpscRing.
class TraceWriter {
 public:
  static Result<TraceWriter> create(const std::string& path, std::uint64_t max_records = 16'000'000);
  TraceWriter(TraceWriter&&) noexcept;
  TraceWriter& operator=(TraceWriter&&) noexcept;
  ~TraceWriter();

  void add(const TraceRecord& record);
  std::uint64_t dropped() const { return dropped_; }
  Status flush();

 private:
  explicit TraceWriter(int fd, std::string path, std::uint64_t max) : fd_(fd), path_(std::move(path)), left_(max) {}
  int fd_ = -1;
  std::string path_;
  std::vector<TraceRecord> buffer_;
  std::uint64_t left_ = 0;
  std::uint64_t dropped_ = 0;
};

/// Reads a whole trace; a torn last record (a killed writer) is left out.
Result<std::vector<TraceRecord>> read_trace(const std::string& path);

}  // namespace ledgerline
