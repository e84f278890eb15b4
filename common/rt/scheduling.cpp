#include "common/rt/scheduling.hpp"

#include <fmt/format.h>
#include <sched.h>

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

}  // namespace ledgerline
