#include <fmt/format.h>
#include <fmt/ranges.h>

#include <utility>

#include "tools/report/results.hpp"

namespace ledgerline::report {
namespace {

std::string ms_row(const std::string& name, const Quantiles& q) {
  if (q.count == 0) return fmt::format("  {:<28}{:>9}\n", name, "no sample");
  return fmt::format("  {:<28}{:>9.1f}{:>9.1f}{:>9.1f}{:>9.1f}{:>9.1f}{:>9.1f}{:>9.1f}{:>9}\n", name, q.p5, q.q1,
                     q.median, q.q3, q.p95, q.p99, q.max, q.count);
}

/// What its failsafe did, when and why; who stopped it, or what else went wrong.
std::string event_lines(const DroneResult& drone) {
  constexpr std::size_t max_shown = 20;
  std::vector<std::string> lines;
  std::string before;
  for (const ModeChange& one : drone.modes) {
    const std::string was = std::exchange(before, one.mode + one.cause);
    if (one.mode == "none" || was == before) continue;  // its phase alone changed
    if (lines.size() == max_shown) {
      lines.push_back("and more: report.html has them all");
      break;
    }
    lines.push_back(fmt::format("{:.1f} s: {} ({})", one.t_s, one.mode, one.cause));
  }
  if (!drone.why.empty()) lines.push_back(drone.why);
  std::string text;
  for (const std::string& line : lines) text += fmt::format("  {:<10}{}\n", drone.id, line);
  return text;
}

}  // namespace

std::string to_table(const Results& r) {
  std::string text = fmt::format("\n  {:<28}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}\n", "latency, ms", "p5", "q1",
                                 "median", "q3", "p95", "p99", "max", "count");
  for (const DroneResult& d : r.drones) {
    text += ms_row(d.id + " two-way", d.two_way_ms);
    text += ms_row(d.id + " age at application", d.age_ms);
  }
  if (r.drones.size() > 1) {
    text += ms_row("all drones, two-way", r.two_way_ms);
    text += ms_row("all drones, age", r.age_ms);
  }
  const PublishedBox& box = published_for(ground::name_of(r.asked.shape), r.asked.drones);
  text += fmt::format("  {:<28}{:>9}{:>9.0f}{:>9.0f}{:>9.0f}{:>9}{:>9}{:>9}   whiskers {:.0f} to {:.0f}\n",
                      fmt::format("published two-way, {}", box.name), "", 1e3 * box.q1_s, 1e3 * box.median_s,
                      1e3 * box.q3_s, "", "", "", 1e3 * box.low_s, 1e3 * box.high_s);
  text += "\n  What differs:\n";
  for (const auto& difference : differences(r)) text += "    " + difference + "\n";

  if (const auto faults = fault_lines(r); !faults.empty())
    text += fmt::format("\n  Faults:\n    {}\n", fmt::join(faults, "\n    "));

  text += fmt::format("\n  {:<10} {:>9} {:>9} {:>11}  {:<48}  {}\n", "path", "rms, m", "max, m", "laps, s", "states",
                      "commands");
  for (const DroneResult& d : r.drones) {
    double laps_s = 0;
    for (double lap : d.lap_s) laps_s += lap;
    const std::string laps =
        d.lap_s.empty() ? "-"
                        : fmt::format("{} x {:.1f}", d.lap_s.size(), laps_s / static_cast<double>(d.lap_s.size()));
    text += fmt::format(
        "  {:<10} {:>9} {:>9} {:>11}  {:<48}  {}\n", d.id,
        d.path_flown ? fmt::format("{:.3f}", d.cross_track_rms_m) : "-",
        d.path_flown ? fmt::format("{:.3f}", d.cross_track_max_m) : "-", laps,
        fmt::format("{} on the ledger, {} merged, {} dropped", d.states.on_ledger, d.states.merged, d.states.dropped),
        fmt::format("{} of {} on the ledger, {} applied, {} refused, {} late, {} dropped", d.commands.on_ledger,
                    d.commands.sent, d.commands.applied, d.commands.refused, d.commands.late, d.commands.dropped));
    if (r.asked.own) text += fmt::format("  {:<10}{}\n", "", no_truth);
    if (d.slowed_to_mps) {
      text +=
          fmt::format("  {:<10}slowed to {:.2f} m/s for a while: its commands were flown late\n", "", *d.slowed_to_mps);
    }
    for (const auto& [reason, count] : d.reasons) text += fmt::format("  {:<10}{} x {}\n", "", count, reason);
  }
  std::string events;
  for (const DroneResult& d : r.drones) events += event_lines(d);
  if (!events.empty()) text += "\n  Failsafe and stops:\n" + events;
  text += fmt::format("\n  {:.1f} messages/s, {:.1f} transactions/s over {:.1f} s; ledger: ", r.messages_per_s,
                      r.transactions_per_s, r.flight_s);
  if (launcher::is_of_others(r.asked)) {
    text += "a network of others\n";
  } else {
    text += fmt::format("{} blocks, {} transactions, on {}{}\n", r.blocks, r.transactions, r.storage,
                        r.disk_ms.count == 0
                            ? ""
                            : fmt::format(" ({:.1f} ms a block, at most {:.0f})", r.disk_ms.median, r.disk_ms.max));
    text += fmt::format("  the ledger grows by {:.2f} GB per drone and hour\n", r.bytes_per_drone_hour * 1e-9);
  }
  for (const auto& counts : {r.restarts, r.onboard_restarts}) {
    for (const auto& [name, count] : counts) text += fmt::format("  {} was restarted {} x\n", name, count);
  }
  text += "  CPU:";
  for (const auto& [name, percent] : r.cpu_percent) text += fmt::format("  {} {:.1f} %", name, percent);
  text += "\n  memory:";
  for (const auto& [name, mb] : r.memory_mb) text += fmt::format("  {} {:.0f} MB", name, mb);
  text += "\n";
  for (const auto& file : r.missing) text += fmt::format("  missing or unreadable: {}\n", file);
  return text;
}

}  // namespace ledgerline::report
