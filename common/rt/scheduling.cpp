#include "common/rt/scheduling.hpp"

#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>

namespace ledgerline {
namespace {

constexpr int lowest = 19;
constexpr unsigned slice_ns = 100'000;

}  // namespace

bool enter_scheduling(Scheduling scheduling) noexcept {
  if (scheduling == Scheduling::inherited) return true;
  if (scheduling == Scheduling::short_slices && ::sched_getscheduler(0) != SCHED_OTHER) return true;
  errno = 0;
  const int nice = ::getpriority(PRIO_PROCESS, 0);  // -1 is a good answer, too
  if (nice == -1 && errno != 0) return false;
  SchedulingAttributes attributes;
  attributes.policy = scheduling == Scheduling::background ? SCHED_BATCH : SCHED_OTHER;
  attributes.nice = scheduling == Scheduling::background ? lowest : nice;
  attributes.runtime = scheduling == Scheduling::short_slices ? slice_ns : 0;  // 0: the kernel's own
  return ::syscall(SYS_sched_setattr, 0, &attributes, 0) == 0;
}

}  // namespace ledgerline
