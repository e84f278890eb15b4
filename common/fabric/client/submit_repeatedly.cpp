#include "common/fabric/client/submit_repeatedly.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <random>
#include <thread>

#include "common/fabric/client/client.hpp"

namespace ledgerline::fabric {

Outcome submit_repeatedly(Client& client, const Call& call, const RepeatLimits& limits,
                          const std::function<void(const Outcome&)>& on_first_failure) {
  Repeat repeat(limits, std::random_device{}(), monotonic_ns());
  while (true) {
    Outcome outcome = client.submit_and_wait(call);
    const auto next = repeat.ended(monotonic_ns(), outcome);
    if (next == Repeat::Next::given_up && repeat.attempts() > 1) {
      outcome.message = fmt::format(
          "not on the ledger after {} attempts{}; the last: {}", repeat.attempts(),
          limits.conflicts_only ? "" : fmt::format(" in {:g} s", to_seconds(limits.within_ns)), outcome.message);
    }
    if (next != Repeat::Next::again) return outcome;
    if (repeat.attempts() == 1 && on_first_failure) on_first_failure(outcome);
    std::this_thread::sleep_for(std::chrono::nanoseconds(std::max<TimeNs>(0, repeat.at_ns() - monotonic_ns())));
  }
}

}  // namespace ledgerline::fabric
