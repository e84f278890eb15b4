// What the trace costs: a record on the loop's side of the ring and on the writer's, and how late a 1 kHz loop is with
// it and without it, in turns of a second so that both see the same machine.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <ctime>
#include <memory>
#include <thread>

#include "common/rt/loop_ticker.hpp"
#include "common/rt/spsc_ring.hpp"
#include "common/rt/trace.hpp"

namespace {

using namespace ledgerline;
using Ring = SpscRing<TraceRecord, 16384>;

constexpr int counted = 16'384;

void print(const char* what, TimeNs ns, int count) {
  fmt::print("{:<52}{:>9.1f} ns\n", what, static_cast<double>(ns) / count);
}

void print(const char* what, const Histogram& h) {
  fmt::print("{:<34} p50 {:>5.0f}  p99 {:>5.0f}  p99.9 {:>5.0f}  max {:>6.0f} us, {} turns\n", what,
             1e3 * to_ms(h.quantile(0.5)), 1e3 * to_ms(h.quantile(0.99)), 1e3 * to_ms(h.quantile(0.999)),
             1e3 * to_ms(h.max()), h.count());
}

void measure_records(Ring& ring, TraceWriter& writer) {
  TraceRecord record;
  record.kind = TraceKind::state_sampled;
  const TimeNs begin = monotonic_ns();
  for (int i = 0; i < counted; ++i) {
    record.id = static_cast<std::uint64_t>(i);
    (void)ring.push(record);
  }
  const TimeNs pushed = monotonic_ns();
  while (ring.pop(record)) writer.add(record);
  (void)writer.flush();
  const TimeNs written = monotonic_ns();
  PackedTurns packed;
  for (int i = 0; i < counted; ++i) {
    if (packed.add(i, i + 1000)) (void)ring.push(packed.record());
  }
  const TimeNs noted = monotonic_ns();
  while (ring.pop(record)) {
  }
  print("a record into the ring (real-time loop)", pushed - begin, counted);
  print("a record out of the ring and into the file", written - pushed, counted);
  print("a turn's lateness into the ring (real-time loop)", noted - written, counted);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"What tracing costs a real-time loop, and its writer.", "bench_trace"};
  int seconds = 20, records = 3, cpu = -1;
  std::string file = "/tmp/bench.trace";
  app.add_option("--seconds", seconds, "Of the loop, half of them with the trace")
      ->check(CLI::Range(2, 3600))
      ->capture_default_str();
  app.add_option("--records", records, "A turn: 3 are what 16 drones at 50 Hz make")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  app.add_option("--cpu", cpu, "Core of the loop (default: any)");
  app.add_option("--file", file, "The trace")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  auto writer = TraceWriter::create(file);
  if (!writer) {
    fmt::print(stderr, "{}\n", writer.error().message);
    return 1;
  }
  auto ring = std::make_unique<Ring>();
  measure_records(*ring, *writer);

  std::atomic<bool> ended{false};
  Histogram with, without;
  double cpu_with_s = 0, cpu_without_s = 0;
  std::uint64_t lost = 0;
  std::thread loop([&] {
    for (const std::string& notice : enter_real_time(80, cpu).notices) fmt::print("note: {}\n", notice);
    PackedTurns packed;
    TraceRecord record;
    for (int second = 0; second < seconds; ++second) {
      const bool traced = second % 2 == 0;
      LoopTicker turns(ns_per_ms);
      const TimeNs cpu_before = read_clock(CLOCK_THREAD_CPUTIME_ID);
      for (int i = 0; i < 1000; ++i) {
        const TimeNs now = turns.wait();
        (traced ? with : without).add(now - turns.due_ns());
        if (!traced) continue;
        if (packed.add(turns.due_ns(), now)) lost += ring->push(packed.record()) ? 0 : 1;
        for (int k = 0; k < records; ++k) {
          record.t_ns = now;
          lost += ring->push(record) ? 0 : 1;
        }
      }
      (traced ? cpu_with_s : cpu_without_s) += to_seconds(read_clock(CLOCK_THREAD_CPUTIME_ID) - cpu_before);
    }
    ended = true;
  });
  while (!ended) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    for (TraceRecord record; ring->pop(record);) writer->add(record);
  }
  loop.join();
  print("the loop, late, with the trace", with);
  print("the loop, late, without it", without);
  fmt::print("CPU of the loop: {:.3f} % of a core with the trace, {:.3f} % without; {} records lost\n",
             100 * cpu_with_s / ((seconds + 1) / 2), 100 * cpu_without_s / (seconds / 2), lost);
  return 0;
}
