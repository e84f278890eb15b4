#pragma once
#include <absl/synchronization/mutex.h>

namespace ledgerline::fabric {

/// Debian builds gRPC's locks so that each looks for a deadlock first, which costs a twentieth of a transaction's time.
/// Called before a channel or server is made; any thread.
inline void take_locks_at_once() { absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore); }

}  // namespace ledgerline::fabric
