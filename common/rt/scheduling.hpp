#pragma once
#include <cstdint>

namespace ledgerline {

/// How a program competes for the processors of a busy host, with all threads and programs that it starts. None of
/// these is a real-time class: a thread that spins under one takes no more than its share.
enum class Scheduling {
  inherited,  ///< as the program that starts it
  /// SCHED_BATCH, nice 19: a seventieth of the share of others, and it interrupts nobody. SCHED_IDLE has a fifth of
  /// that, too little for peers to keep up.
  background,
  /// The same share in slices of 0.1 ms, which Linux takes from 6.12 on and older ones leave out: the shorter a
  /// thread's slice the earlier is its turn when it wakes. 0.1 ms is the kernel's least. Another class than
  /// SCHED_OTHER stays as it is.
  short_slices,
};

/// For the calling thread; allocates nothing, as between fork and exec. False: refused, see errno.
bool enter_scheduling(Scheduling scheduling) noexcept;

/// `struct sched_attr` of sched_setattr(2), which Debian 12's headers do not let stand beside <sched.h>.
struct SchedulingAttributes {
  std::uint32_t size = sizeof(SchedulingAttributes), policy = 0;
  std::uint64_t flags = 0;
  std::int32_t nice = 0;
  std::uint32_t priority = 0;
  std::uint64_t runtime = 0, deadline = 0, period = 0;  ///< ns; of ordinary threads `runtime` is the slice
};
static_assert(sizeof(SchedulingAttributes) == 48, "the kernel's SCHED_ATTR_SIZE_VER0");

}  // namespace ledgerline
