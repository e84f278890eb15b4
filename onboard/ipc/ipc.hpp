#pragma once
#include <sys/un.h>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"

/// The shared-memory channel between link and agent: iceoryx behind plain functions, so that no other header includes
/// it. Each end takes in one thread and sends in one, which may be another; no call uses the heap after construction.
/// To receive is lock-free. To send is not: a process killed meanwhile may hold a lock of iceoryx 2.0 in shared memory.
namespace ledgerline::ipc {

/// A chunk of shared memory for a plan, which is the largest, with iceoryx's header.
inline constexpr std::uint32_t plan_chunk_bytes = (sizeof(Plan) + 128 + 63) / 64 * 64;

/// Must be called once a process, before any end is made. Without a RouDi iceoryx waits, so this checks first that it
/// answers. One that takes the call and never answers is waited for, up to a minute, unless `is_asked_to_end`: then the
/// process is to end, since iceoryx waits on.
Status connect(const std::string& program, const std::function<bool()>& is_asked_to_end = {});

/// Whether RouDi still answers: a dead one is silent (old links flow, new ends never join), so each process asks at
/// times, from a thread that may block. False for good once another took its place.
bool is_roudi_alive();

class LinkEnd {
 public:
  static Result<std::unique_ptr<LinkEnd>> create();
  virtual ~LinkEnd() = default;
  virtual bool receive_plan(Plan& out) noexcept = 0;
  virtual bool receive_pose(Pose& out) noexcept = 0;
  virtual bool receive_heartbeat(AgentHeartbeat& out) noexcept = 0;
  /// False when there is no chunk left: the sample is lost and the caller counts it.
  virtual bool send_state(const StateSample& sample) noexcept = 0;
  virtual bool send_transition(const Transition& transition) noexcept = 0;
  /// Behind what was sent: agent is to look. One system call that does not wait.
  virtual void wake_agent() noexcept = 0;
};

/// agent's end. One of them at a time in a machine's /tmp.
class AgentEnd {
 public:
  static Result<std::unique_ptr<AgentEnd>> create();
  virtual ~AgentEnd() = default;
  virtual bool receive_state(StateSample& out) noexcept = 0;
  virtual bool receive_transition(Transition& out) noexcept = 0;
  virtual bool send_plan(const Plan& plan) noexcept = 0;
  virtual bool send_pose(const Pose& pose) noexcept = 0;
  virtual bool send_heartbeat(const AgentHeartbeat& heartbeat) noexcept = 0;
  /// Readable once link has sent something, until woken().
  virtual int wake_fd() const noexcept = 0;
  /// Whether link woke this end since the last call. To be called before the takes, so that no wake is lost.
  virtual bool woken() noexcept = 0;
};

/// Wakes another process: a datagram socket with a name. A notification carries no data, so the data is written before
/// it. Where the socket is full, earlier notifications wait in it that the owner clears before it reads the data. So
/// nothing is missed while the owner lives, and an owner that restarts reads the data at its start.
///
/// Its file belongs to the owner's user alone (mode 0600): the kernel refuses notifications of other users.
class WakeupSink {
 public:
  /// Replaces the socket that a dead owner left. No other owner of this path may live.
  static Result<std::unique_ptr<WakeupSink>> create(const std::string& path);
  ~WakeupSink();
  WakeupSink(const WakeupSink&) = delete;
  WakeupSink& operator=(const WakeupSink&) = delete;

  /// Readable from a notification to the next clear().
  int fd() const noexcept { return fd_; }
  /// True if a notification came since the last call. To be called before the data is read. Does not wait.
  bool clear() noexcept;

 private:
  WakeupSink(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
  const int fd_;
  const std::string path_;
};

/// The other end. Knows the path alone, so it outlives sinks, and may be there before the first one.
class WakeupSource {
 public:
  static Result<WakeupSource> create(const std::string& path);
  WakeupSource(WakeupSource&& other) noexcept;
  WakeupSource& operator=(WakeupSource&&) = delete;
  ~WakeupSource();

  /// One send that does not wait. Without a sink, or with a full one, it does nothing.
  void notify() noexcept;

 private:
  WakeupSource(int fd, const sockaddr_un& address) : fd_(fd), address_(address) {}
  int fd_;
  sockaddr_un address_;
};

}  // namespace ledgerline::ipc
