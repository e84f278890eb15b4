#include "common/rt/loop_ticker.hpp"

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

}  // namespace ledgerline
