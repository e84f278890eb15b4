#include "common/rt/real_time.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>

#include <cerrno>
#include <cstring>

namespace ledgerline {

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
