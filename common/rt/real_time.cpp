#include "common/rt/real_time.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

#include <cerrno>
#include <cstring>

namespace ledgerline {

RealTime enter_real_time(int priority, int cpu) {
  RealTime result;
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
    sched_param param{};
    param.sched_priority = priority;
    const int error = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &param);
    result.scheduled = error == 0;
    if (error != 0) {
      result.notices.push_back(
          fmt::format("no SCHED_FIFO: {}; grant CAP_SYS_NICE (setcap cap_sys_nice,cap_ipc_lock+ep) for steady timing",
                      std::strerror(error)));
    }
    result.locked = ::mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    if (!result.locked) {
      result.notices.push_back(
          fmt::format("memory is not locked: {}; grant CAP_IPC_LOCK or raise ulimit -l", std::strerror(errno)));
    }
  }
  return result;
}

}  // namespace ledgerline
