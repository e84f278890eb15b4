#include "tools/timing/self_test.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <sstream>
#include <thread>

#include "common/process/children.hpp"
#include "common/process/usage.hpp"
#include "common/rt/loop_ticker.hpp"
#include "tools/timing/metrics.hpp"

namespace ledgerline::timing {
namespace {

constexpr TimeNs period_ns = ns_per_ms;
constexpr int histogram_us = 2000;
constexpr TimeNs overrun_ns = ns_per_ms;
constexpr double max_p999_ms = 0.2, max_of_cyclictest = 1.5, beyond_cyclictest_ms = 0.05;
constexpr TimeNs timeout_ns = 10 * ns_per_s;

std::vector<std::string> cyclictest_command(const std::string& file, const SelfTestOptions& asked,
                                            const RealTime& real) {
  std::vector<std::string> command{file,
                                   "--quiet",
                                   "--threads=1",
                                   fmt::format("--affinity={}", asked.cpu),
                                   fmt::format("--interval={}", period_ns / ns_per_us),
                                   fmt::format("--loops={:.0f}", asked.seconds * 1e9 / static_cast<double>(period_ns)),
                                   fmt::format("--histogram={}", histogram_us)};
  if (real.scheduled) {
    command.push_back(fmt::format("--priority={}", asked.priority - 1));
  } else {
    command.push_back("--policy=other");
  }
  if (real.locked) command.push_back("--mlockall");
  return command;
}

std::string row(const std::string& name, const Lateness& l) {
  const Tail t = tail_of(l.late);
  return fmt::format("  {:<24}{:>8.0f}{:>8.0f}{:>8.0f}{:>8.0f}{:>9.0f}{:>10}{:>10}\n", name, 1e3 * t.p50, 1e3 * t.p95,
                     1e3 * t.p99, 1e3 * t.p999, 1e3 * t.max, l.overruns, t.count);
}

}  // namespace

bool SelfTest::good() const {
  const double ours = tail_of(loop.late).p999;
  if (loop.late.count() == 0 || ours > max_p999_ms) return false;
  return !cyclictest || ours <= max_of_cyclictest * tail_of(cyclictest->late).p999 + beyond_cyclictest_ms;
}

Result<Lateness> parse_cyclictest(const std::string& output) {
  Lateness lateness;
  std::istringstream lines(output);
  std::uint64_t beyond = 0;
  TimeNs max_ns = 0;
  for (std::string line; std::getline(lines, line);) {
    std::istringstream in(line);
    TimeNs us = 0;
    std::uint64_t count = 0;
    const auto value_of = [&](const std::string& key) {
      return line.starts_with(key) ? std::strtoull(line.c_str() + key.size(), nullptr, 10) : 0;
    };
    if (const auto max_us = value_of("# Max Latencies:")) max_ns = static_cast<TimeNs>(max_us) * ns_per_us;
    if (const auto more = value_of("# Histogram Overflows:")) beyond = more;
    if (line.starts_with("#") || !(in >> us >> count)) continue;
    for (std::uint64_t i = 0; i < count; ++i) lateness.late.add(us * ns_per_us);
    if (us * ns_per_us > overrun_ns) lateness.overruns += count;
  }
  // Of those beyond the histogram only the worst is known: each counts as that.
  for (std::uint64_t i = 0; i < beyond; ++i) lateness.late.add(max_ns);
  lateness.overruns += beyond;
  if (lateness.late.count() == 0) return Error{"cyclictest printed no histogram: " + output.substr(0, 300)};
  return lateness;
}

SelfTest run_self_test(const SelfTestOptions& asked) {
  SelfTest test;
  test.asked = asked;
  const std::string core = fmt::format("cpu{}", asked.cpu);
  const double steal_before_s = read_host(core).steal_s;
  const TimeNs begin_ns = monotonic_ns();
  const auto turns_wanted = static_cast<std::uint64_t>(asked.seconds * 1e9 / static_cast<double>(period_ns));

  std::atomic<bool> entered{false}, ended{false};
  std::thread loop([&] {
    test.real_time = enter_real_time(asked.priority, asked.cpu);
    entered = true;
    LoopTicker turns(period_ns);
    while (turns.count() < turns_wanted) turns.wait();
    test.loop = {turns.late(), turns.overruns()};
    ended = true;
  });
  while (!entered) ::usleep(1000);

  std::string output;
  Children children([&](const std::string&, const std::string& line) { output += line + "\n"; });
  const std::string file = find_program("cyclictest", "/usr/bin:/usr/sbin");
  if (file.empty()) {
    test.why_no_cyclictest = "cyclictest is not installed: apt-get install rt-tests";
  } else if (auto s = children.start(
                 {"cyclictest", cyclictest_command(file, asked, test.real_time), "/dev/stderr", SIGKILL});
             !s) {
    test.why_no_cyclictest = s.error().message;
  }
  const TimeNs until_ns = begin_ns + from_seconds(asked.seconds) + timeout_ns;
  while (!ended || (children.is_running("cyclictest") && monotonic_ns() < until_ns)) children.poll(50 * ns_per_ms);
  loop.join();
  test.seconds = to_seconds(monotonic_ns() - begin_ns);
  test.steal_s = read_host(core).steal_s - steal_before_s;
  if (!test.why_no_cyclictest.empty()) return test;
  if (!children.has_succeeded("cyclictest")) {
    test.why_no_cyclictest = children.is_running("cyclictest") ? "cyclictest did not end in time"
                                                               : "cyclictest " + children.how_it_ended("cyclictest");
    return test;
  }
  if (auto parsed = parse_cyclictest(output)) {
    test.cyclictest = std::move(*parsed);
  } else {
    test.why_no_cyclictest = parsed.error().message;
  }
  return test;
}

std::string criterion() {
  return fmt::format("p99.9 of link's loop at most {:.0f} us, and {} times cyclictest's plus {:.0f} us",
                     1e3 * max_p999_ms, max_of_cyclictest, 1e3 * beyond_cyclictest_ms);
}

std::string to_table(const SelfTest& test) {
  std::string text = fmt::format("\n  {:<24}{:>8}{:>8}{:>8}{:>8}{:>9}{:>10}{:>10}\n", "late, us", "p50", "p95", "p99",
                                 "p99.9", "max", "overruns", "turns");
  const auto name = [&](const std::string& who, int priority) {
    return test.real_time.scheduled ? fmt::format("{}, FIFO {}", who, priority) : who + ", not FIFO";
  };
  text += row(name("link's loop", test.asked.priority), test.loop);
  if (test.cyclictest) text += row(name("cyclictest", test.asked.priority - 1), *test.cyclictest);
  text += fmt::format("\n  core {}, {:.1f} s; steal {:.2f} s (the host of this machine ran others)\n", test.asked.cpu,
                      test.seconds, test.steal_s);
  for (const std::string& notice : test.real_time.notices) text += "  note: " + notice + "\n";
  if (!test.cyclictest) text += "  note: nothing to compare with: " + test.why_no_cyclictest + "\n";
  return text;
}

}  // namespace ledgerline::timing
