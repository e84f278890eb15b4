#pragma once
#include <functional>
#include <memory>
#include <string>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"

/// The shared-memory channel between link and agent: iceoryx behind plain functions, so that no other header includes
/// it. Each end takes in one thread and sends in one, which may be another; no call uses the heap after construction. A
/// take is lock-free. A send is not: iceoryx 2.0 locks in shared memory, so a process killed at that moment may hold
/// it.
namespace ledgerline::ipc {

/// Must be called once a process, before any end is made. RouDi must be running: without it iceoryx waits, so this
/// checks first that it answers and returns an error that names the cure.
/// A RouDi that takes the call and never answers is waited for, up to a minute, unless `is_asked_to_end` says so: then
/// the process is to end, since iceoryx waits on.
Status connect(const std::string& program, const std::function<bool()>& is_asked_to_end = {});

/// Whether RouDi still answers: a dead one is silent (old links flow, new ends never join), so each process asks now
/// and then, from a thread that may block for a moment. False for good once another RouDi took its place: only a
/// new start of this process connects it to that one.
bool roudi_lives();

/// link's end.
class LinkEnd {
 public:
  static Result<std::unique_ptr<LinkEnd>> create();
  virtual ~LinkEnd() = default;
  virtual bool take_plan(Plan& out) noexcept = 0;
  virtual bool take_pose(Pose& out) noexcept = 0;
  virtual bool take_heartbeat(AgentHeartbeat& out) noexcept = 0;
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
  virtual bool take_state(StateSample& out) noexcept = 0;
  virtual bool take_transition(Transition& out) noexcept = 0;
  virtual bool send_plan(const Plan& plan) noexcept = 0;
  virtual bool send_pose(const Pose& pose) noexcept = 0;
  virtual bool send_heartbeat(const AgentHeartbeat& heartbeat) noexcept = 0;
  /// Readable once link has sent something, until woken().
  virtual int wake_fd() const noexcept = 0;
  /// Whether link woke this end since the last call. To be called before the takes, so that no wake is lost.
  virtual bool woken() noexcept = 0;
};

}  // namespace ledgerline::ipc
