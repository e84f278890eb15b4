#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline {

/// What a trace record is about. Values are part of the file format: only append.
enum class TraceKind : std::uint16_t {
  truth = 1,             ///< sim: id 0, stamp 0, v = x, y, z [m], yaw [rad]; extra = 1 while in flight, 2 once it
                         ///< turned over
  state_sampled = 2,     ///< link: id = state sequence, stamp = its time, v = x, y, z [m], yaw [rad]; without a pose
                         ///< x and y are NaN and z is its own height; extra = battery, per mille, 0: not known
  batch_submitted = 3,   ///< agent: id = batch number, extra = samples in it
  batch_committed = 4,   ///< agent: id = batch number, extra = samples in it, stamp = when it was submitted
  state_received = 5,    ///< ground: id = state sequence, stamp = the state's
  command_made = 6,      ///< ground: id = plan sequence, stamp = its state's, v = vx, vy, vz [m/s] of its first
                         ///< setpoint, progress [m]; extra = its action
  command_verified = 7,  ///< agent: id = plan sequence, stamp = its state's; two-way latency = t - stamp
  command_applied = 8,  ///< link: id = plan sequence, stamp = its state's; age at application = t - stamp; v = setpoint
                        ///< as sent; extra = how late, us: t minus when it was meant for
  mode = 9,             ///< link: id = flight phase, extra = failsafe mode, v[0] = its cause
  refused = 10,         ///< agent or link: id = plan sequence, stamp = its state's, extra = reason
  state_taken = 11,     ///< agent: id = state sequence, stamp = the state's; out of link's ring
  state_batched = 12,   ///< agent: id = state sequence, stamp = the state's, extra = batch number
  call_endorsed = 13,   ///< agent: id = batch number; ground: id = call number; stamp = when it was submitted
  call_ordered = 14,    ///< the same, when the orderer acknowledged it
  command_submitted = 15,  ///< ground: id = plan sequence, stamp = its state's, extra = call number
  command_in_block = 16,   ///< agent: id = plan sequence, stamp = its state's; when its block reached this host
  command_taken = 17,      ///< agent: the same, when the main loop took the block up; what follows is its checking
  plan_received = 18,      ///< link: id = plan sequence, stamp = its state's; out of agent's ring; extra = playout's
                           ///< margin then, us
  setpoint_sent = 19,      ///< link: as command_applied, when the datagram was the kernel's
  loop_turns = 20,         ///< link: id = number of the first turn, extra = how many, stamp = when the first was due,
                           ///< v = how late each began: 16 × 16 bits, us (PackedTurns in common/rt/loop_ticker.hpp)
  rc_sent = 21,            ///< link: v = the four sticks of an rc, as the SDK has them
  pose_reported = 22,      ///< link: id = state sequence, t = that of its state_sampled, stamp = the pose's, v = its
                           ///< variances along x, y, z [m2] and of yaw [rad2]; only of a pose that has any
  setpoint_left = 23,      ///< link: as command_applied, when the network device had the datagram (SO_TIMESTAMPING)
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

/// Appends records to a file, buffered for at most a second of records; bounded: after `max_records` further ones are
/// only counted, and dropped() says so. One thread, not a real-time loop's.
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

/// Reads a trace while it grows: each call brings what is new and whole. One thread.
class TraceReader {
 public:
  static Result<TraceReader> open(const std::string& path);
  TraceReader(TraceReader&& other) noexcept : fd_(std::exchange(other.fd_, -1)), path_(std::move(other.path_)) {}
  TraceReader& operator=(TraceReader&&) = delete;
  ~TraceReader();

  Result<std::vector<TraceRecord>> read_new();

 private:
  TraceReader(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
  int fd_;
  std::string path_;
};

/// Reads a whole trace; a torn last record (a killed writer) is left out.
Result<std::vector<TraceRecord>> read_trace(const std::string& path);

}  // namespace ledgerline
