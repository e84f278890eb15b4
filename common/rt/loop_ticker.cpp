#include "common/rt/loop_ticker.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>

namespace ledgerline {

TimeNs LoopTicker::wait() noexcept {
  const timespec at{static_cast<time_t>(next_ns_ / ns_per_s), static_cast<long>(next_ns_ % ns_per_s)};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) == EINTR) {
  }
  const TimeNs now = monotonic_ns();
  due_ns_ = next_ns_;
  const TimeNs late = now - due_ns_;
  late_.add(late);
  const bool overrun = late > period_ns_;
  if (overrun) ++overruns_;
  next_ns_ = (overrun ? now : due_ns_) + period_ns_;
  return now;
}

bool PackedTurns::add(TimeNs due_ns, TimeNs begun_ns) noexcept {
  static_assert(sizeof late_us_ == sizeof record_.v);
  if (record_.extra == 0 || record_.extra == capacity) {
    record_ = {.kind = TraceKind::loop_turns, .id = turns_, .stamp_ns = due_ns};
    late_us_ = {};
  }
  ++turns_;
  late_us_[record_.extra++] =
      static_cast<std::uint16_t>(std::clamp<TimeNs>((begun_ns - due_ns) / ns_per_us, 0, UINT16_MAX));
  record_.t_ns = begun_ns;
  std::memcpy(record_.v, late_us_.data(), sizeof record_.v);
  return record_.extra == capacity;
}

std::vector<std::uint16_t> PackedTurns::late_us(const TraceRecord& record) {
  if (record.kind != TraceKind::loop_turns || record.extra > capacity) return {};
  std::vector<std::uint16_t> late_us(capacity);
  std::memcpy(late_us.data(), record.v, sizeof record.v);
  late_us.resize(record.extra);
  return late_us;
}

Status schedule_fifo(int priority) {
  sched_param param{};
  param.sched_priority = priority;
  if (::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &param) == 0) return done;
  return Error{
      fmt::format("no SCHED_FIFO: {}; grant CAP_SYS_NICE (setcap cap_sys_nice,cap_ipc_lock+ep) for steady timing",
                  std::strerror(errno))};
}

RealTime enter_real_time(int priority, int cpu) {
  RealTime result;
  // Without SCHED_FIFO the kernel may put a wake-up off by 50 us, to save power.
  ::prctl(PR_SET_TIMERSLACK, 1);
  if (cpu >= 0) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(cpu), &set);
    if (const int error = ::pthread_setaffinity_np(::pthread_self(), sizeof set, &set); error != 0) {
      result.notices.push_back(
          fmt::format("cannot pin the loop to CPU {}: {}; set [realtime] cpu", cpu, std::strerror(error)));
    }
  }
  if (priority > 0) {
    const Status fifo = schedule_fifo(priority);
    result.scheduled = fifo.ok();
    if (!fifo) result.notices.push_back(fifo.error().message);
    result.locked = ::mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    if (!result.locked) {
      result.notices.push_back(
          fmt::format("memory is not locked: {}; grant CAP_IPC_LOCK or raise ulimit -l", std::strerror(errno)));
    }
  }
  return result;
}

}  // namespace ledgerline
