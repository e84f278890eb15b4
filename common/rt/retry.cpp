#include "common/rt/retry.hpp"

#include <fmt/format.h>

#include <chrono>
#include <random>
#include <thread>

#include "common/base/log.hpp"

namespace ledgerline {

TryWorld TryWorld::real() {
  return {.now = monotonic_ns,
          .sleep = [](TimeNs pause_ns) { std::this_thread::sleep_for(std::chrono::nanoseconds(pause_ns)); },
          .warn = [](const std::string& what) { spdlog::warn("{}", what); },
          .seed = std::random_device{}()};
}

Status retry(const std::string& what, const TryLimits& limits, const std::function<bool()>& stop,
             const std::function<Status()>& attempt, const TryWorld& world) {
  BackOff pause(limits.first_pause_ns, limits.max_pause_ns);
  Random random(world.seed);
  const TimeNs begin_ns = world.now();
  TimeNs next_message_ns = begin_ns + limits.say_first_after_ns;
  while (true) {
    const Status status = attempt();
    if (status) return done;
    if (stop()) return Error{fmt::format("asked to end before {}", what)};
    const TimeNs now = world.now();
    if (now - begin_ns > limits.within_ns) {
      return Error{fmt::format("gave up after {:.0f} s waiting until {}: {}", to_seconds(limits.within_ns), what,
                               status.error().message)};
    }
    if (now >= next_message_ns) {
      world.warn(fmt::format("waiting until {}: {}", what, status.error().message));
      next_message_ns = now + limits.say_again_after_ns;
    }
    world.sleep(pause.next(random));
  }
}

}  // namespace ledgerline
