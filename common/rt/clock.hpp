#pragma once
#include <cstdint>
#include <ctime>

namespace ledgerline {

/// Nanoseconds of CLOCK_MONOTONIC (or of a simulated clock): the only time that decisions are made with.
using TimeNs = std::int64_t;

inline constexpr TimeNs ns_per_us = 1'000;
inline constexpr TimeNs ns_per_ms = 1'000'000;
inline constexpr TimeNs ns_per_s = 1'000'000'000;

inline TimeNs read_clock(clockid_t id) noexcept {
  timespec t{};
  clock_gettime(id, &t);
  return static_cast<TimeNs>(t.tv_sec) * ns_per_s + t.tv_nsec;
}

inline TimeNs monotonic_ns() noexcept { return read_clock(CLOCK_MONOTONIC); }

/// For ROS headers and Fabric timestamps alone.
inline TimeNs realtime_ns() noexcept { return read_clock(CLOCK_REALTIME); }

inline constexpr double to_seconds(TimeNs t) noexcept { return static_cast<double>(t) * 1e-9; }
inline constexpr double to_ms(TimeNs t) noexcept { return static_cast<double>(t) * 1e-6; }
inline constexpr TimeNs from_seconds(double s) noexcept { return static_cast<TimeNs>(s * 1e9); }

}  // namespace ledgerline
