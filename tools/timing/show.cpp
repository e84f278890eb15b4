#include "tools/timing/metrics.hpp"

#include <fmt/format.h>
#include <sched.h>

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>

#include "common/page/html.hpp"
#include "common/rt/histogram.hpp"
#include "common/rt/loop_ticker.hpp"

namespace ledgerline::report {
extern const char timing_template[];  // page.html, put into the program by CMake
}

namespace ledgerline::timing {
namespace {

using nlohmann::json;

std::string row(std::string_view name, const Histogram& histogram, const std::string& more) {
  const Tail t = tail_of(histogram);
  if (t.count == 0) return fmt::format("  {:<17}{:>10}{:>55}\n", name, "-", more);
  return fmt::format("  {:<17}{:>9.3f}{:>10.3f}{:>10.3f}{:>10.3f}{:>10.3f}{:>9}{:>7}\n", name, t.p50, t.p95, t.p99,
                     t.p999, t.max, t.count, more);
}

const char* name_of_policy(int policy) {
  return policy == SCHED_FIFO ? "FIFO" : policy == SCHED_RR ? "RR" : policy == SCHED_OTHER ? "" : "other";
}

std::string load_table(const Load& load, std::size_t max_threads) {
  if (load.seconds <= 0) return "\n  CPU was not measured\n";
  std::string text = fmt::format("\n  {:<28}{:>8}{:>9}{:>12}{:>12}{:>10}{:>8}  {}\n", "thread", "CPU, %", "wait, ms",
                                 "switches/s", "preempted/s", "faults", "major", "");
  for (std::size_t i = 0; i < std::min(max_threads, load.threads.size()); ++i) {
    const ThreadUsage& t = load.threads[i].who;
    text += fmt::format("  {:<28}{:>8.2f}{:>9.1f}{:>12.1f}{:>12.1f}{:>10}{:>8}  {}\n",
                        fmt::format("{}/{} {}", t.program, t.name, t.thread), load.threads[i].cpu_percent,
                        1e3 * t.waited_s, static_cast<double>(t.voluntary) / load.seconds,
                        static_cast<double>(t.involuntary) / load.seconds, t.minor_faults, t.major_faults,
                        t.policy == SCHED_OTHER ? "" : fmt::format("{} {}", name_of_policy(t.policy), t.priority));
  }
  if (load.threads.size() > max_threads) text += fmt::format("  and {} more\n", load.threads.size() - max_threads);
  text += fmt::format("\n  budget, two cores: {:.0f} %", budget_percent);
  for (const auto& [program, percent] : load.programs) text += fmt::format("  {} {:.1f}", program, percent);
  return text +
         fmt::format("\n  used {:.1f} %, headroom {:.1f} %; the whole machine {:.1f} %, steal {:.2f} s in {:.1f} s\n",
                     load.used_percent(), load.headroom_percent(), load.host_percent, load.steal_s, load.seconds);
}

constexpr int loop_process = 1000;  // behind all drones

class Events {
 public:
  explicit Events(std::ostream& out) : out_(out) { out_ << "{\"displayTimeUnit\":\"ms\",\"traceEvents\":["; }
  ~Events() { out_ << "\n]}\n"; }
  Events(const Events&) = delete;
  Events& operator=(const Events&) = delete;

  /// `more`: further members, each behind a comma.
  void add(std::string_view phase, std::string_view name, int process, std::size_t thread, TimeNs t_ns,
           const std::string& more) {
    out_ << (first_ ? "\n" : ",\n")
         << fmt::format(R"({{"ph":"{}","name":"{}","pid":{},"tid":{},"ts":{}.{:03}{}}})", phase, name, process, thread,
                        t_ns / ns_per_us, t_ns % ns_per_us, more);
    first_ = false;
  }
  void name(int process, const std::string& text) { add_name("process_name", process, 0, text); }
  void name_lane(int process, std::size_t thread, const std::string& text) {
    add_name("thread_name", process, thread, text);
  }

 private:
  void add_name(std::string_view kind, int process, std::size_t thread, const std::string& text) {
    add("M", kind, process, thread, 0, fmt::format(R"(,"args":{{"name":"{}"}})", text));
  }

  std::ostream& out_;
  bool first_ = true;
};

std::string duration(TimeNs ns) { return fmt::format(R"(,"dur":{}.{:03})", ns / ns_per_us, ns % ns_per_us); }

void add_trace(Events& events, const SampleTrace& trace, std::size_t lane) {
  const TimeNs begin_ns = trace.at(Mark::sampled), end_ns = trace.at(trace.last());
  events.add("X", "sample", trace.drone, lane, begin_ns,
             duration(end_ns - begin_ns) + fmt::format(R"(,"args":{{"sequence":{}}})", trace.sequence));
  for (const Stage& stage : stages) {
    if (!trace.has(stage.from) || !trace.has(stage.to)) continue;
    events.add("X", stage.name, trace.drone, lane, trace.at(stage.from),
               duration(trace.at(stage.to) - trace.at(stage.from)));
  }
}

}  // namespace

std::string bars_text(const Histogram& histogram) {
  constexpr std::size_t columns = 40, steps = 2'000;
  constexpr std::array bars{" ", "\u2581", "\u2582", "\u2583", "\u2584", "\u2585", "\u2586", "\u2587", "\u2588"};
  const TimeNs least = histogram.quantile(0), width = (histogram.quantile(0.99) - least) / columns + 1;
  if (histogram.count() < columns) return "";
  std::array<std::size_t, columns> shares{};
  for (std::size_t i = 0; i < steps; ++i) {
    const TimeNs at = histogram.quantile(0.99 * static_cast<double>(i) / steps);
    ++shares[static_cast<std::size_t>((at - least) / width)];
  }
  const std::size_t most = *std::ranges::max_element(shares);
  std::string line;
  for (const std::size_t share : shares) line += bars[(share * (bars.size() - 1) + most - 1) / most];
  return fmt::format("  two_way, {:.1f} ms to p99 {:.1f} ms: {}\n", to_ms(least), to_ms(histogram.quantile(0.99)),
                     line);
}

std::string to_table(const Metrics& f, std::size_t max_threads) {
  std::string text = fmt::format("\n  {:<17}{:>9}{:>10}{:>10}{:>10}{:>10}{:>9}{:>7}\n", "stage, ms", "p50", "p95",
                                 "p99", "p99.9", "max", "count", "ended");
  for (std::size_t i = 0; i < f.distributions.size(); ++i) {
    const bool is_stage = i < stages.size();
    if (i == stages.size()) text += "\n";
    // "ended": samples that came to where this stage begins, and no further.
    const std::uint64_t ended = is_stage ? f.got_to[static_cast<std::size_t>(stages[i].from)] : 0;
    text += row(f.distributions[i].name, f.distributions[i].histogram, is_stage ? std::to_string(ended) : "");
  }
  text += fmt::format("\n  {} samples in {:.1f} s; link's loop: {} turns, {} later than 1 ms\n", f.traces, f.seconds,
                      f.loop.late.count(), f.loop.overruns);
  if (const Histogram* two_way = f.find("two_way")) text += bars_text(*two_way);
  if (f.loop.lost > 0) text += fmt::format("  {} turns are not in the trace\n", f.loop.lost);
  if (f.damaged.strays + f.damaged.backwards + f.damaged.doubled > 0) {
    text += fmt::format(
        "  records: {} doubled, {} of samples that are not in link's trace; {} walks with times that go back\n",
        f.damaged.doubled, f.damaged.strays, f.damaged.backwards);
  }
  return text + load_table(f.load, max_threads);
}

std::string to_table(const std::vector<Verdict>& verdicts) {
  std::string text;
  for (const Verdict& v : verdicts) {
    text += fmt::format(
        "  {} {}: {}{}\n", v.kept ? "kept    " : "NOT KEPT", v.limit,
        v.measured ? fmt::format("{:.3f}{}{}", *v.measured, v.unit.empty() ? "" : " ", v.unit) : "nothing was measured",
        v.note.empty() ? "" : fmt::format(" ({})", v.note));
  }
  return text.empty() ? text : "\n" + text;
}

json to_json(const Tail& t) {
  return {{"p50", rounded(t.p50)},    {"p95", rounded(t.p95)}, {"p99", rounded(t.p99)},
          {"p99.9", rounded(t.p999)}, {"max", rounded(t.max)}, {"count", t.count}};
}

json to_json(const Metrics& f, const std::vector<Verdict>& verdicts) {
  json list = json::array(), sums = json::array(), threads = json::array(), limits = json::array();
  bool ok = true;
  for (std::size_t i = 0; i < f.distributions.size(); ++i) {
    json one = to_json(tail_of(f.distributions[i].histogram));
    one["name"] = f.distributions[i].name;
    one["what"] = f.distributions[i].what;
    if (i < stages.size()) one["ended"] = f.got_to[static_cast<std::size_t>(stages[i].from)];
    (i < stages.size() ? list : sums).push_back(std::move(one));
  }
  for (const ThreadLoad& load : f.load.threads) {
    const ThreadUsage& t = load.who;
    threads.push_back({{"program", t.program},
                       {"name", t.name},
                       {"thread", t.thread},
                       {"cpu_percent", rounded(load.cpu_percent)},
                       {"user_s", rounded(t.user_s)},
                       {"system_s", rounded(t.system_s)},
                       {"waited_s", rounded(t.waited_s, 1e6)},
                       {"voluntary_switches", t.voluntary},
                       {"involuntary_switches", t.involuntary},
                       {"minor_faults", t.minor_faults},
                       {"major_faults", t.major_faults},
                       {"policy", name_of_policy(t.policy)},
                       {"priority", t.priority}});
  }
  for (const Verdict& v : verdicts) {
    limits.push_back({{"limit", v.limit},
                      {"measured", v.measured ? json(rounded(*v.measured)) : json()},
                      {"unit", v.unit},
                      {"kept", v.kept}});
    if (!v.note.empty()) limits.back()["note"] = v.note;
    ok = ok && v.kept;
  }
  json budget = nullptr;
  if (f.load.seconds > 0) {
    json programs = json::object();
    for (const auto& [name, percent] : f.load.programs) programs[name] = rounded(percent);
    budget = {{"percent", budget_percent},
              {"programs", programs},
              {"used_percent", rounded(f.load.used_percent())},
              {"headroom_percent", rounded(f.load.headroom_percent())},
              {"machine_percent", rounded(f.load.host_percent)},
              {"steal_s", rounded(f.load.steal_s)},
              {"seconds", rounded(f.load.seconds)}};
  }
  return {
      {"seconds", rounded(f.seconds)},
      {"samples", f.traces},
      {"stages", list},
      {"totals", sums},
      {"loop", {{"turns", f.loop.late.count()}, {"overruns", f.loop.overruns}, {"lost", f.loop.lost}}},
      {"records", {{"doubled", f.damaged.doubled}, {"strays", f.damaged.strays}, {"backwards", f.damaged.backwards}}},
      {"budget", budget},
      {"threads", threads},
      {"limits", limits},
      {"ok", ok}};
}

std::string to_page(json document) {
  document["date"] = page::local_date();
  return page::filled(report::timing_template, "@DATA@", page::for_script(document));
}

std::size_t write_perfetto(std::ostream& out, std::span<const SampleTrace> traces,
                           std::span<const TraceRecord> loop_turns, std::size_t max_traces) {
  const std::size_t left_out = traces.size() - std::min(max_traces, traces.size());
  traces = traces.subspan(left_out);
  Events events(out);
  std::map<int, std::vector<TimeNs>> lanes;  // of each drone: until when each is taken
  for (const SampleTrace& trace : traces) {
    if (!lanes.contains(trace.drone)) events.name(trace.drone, fmt::format("tello{}", trace.drone));
    std::vector<TimeNs>& taken = lanes[trace.drone];
    const auto free =
        std::find_if(taken.begin(), taken.end(), [&](TimeNs until) { return until <= trace.at(Mark::sampled); });
    const auto lane = static_cast<std::size_t>(free - taken.begin());
    if (free == taken.end()) {
      taken.push_back(0);
      events.name_lane(trace.drone, lane + 1, fmt::format("samples in flight, {}", lane + 1));
    }
    taken[lane] = trace.at(trace.last());
    add_trace(events, trace, lane + 1);
  }
  events.name(loop_process, "link's loop");
  for (const TraceRecord& record : loop_turns) {
    const auto late_us = PackedTurns::late_us(record);
    if (late_us.empty() || record.t_ns < 0) continue;
    events.add("C", "late_us", loop_process, 0, record.t_ns,
               fmt::format(R"(,"args":{{"late_us":{}}})", *std::max_element(late_us.begin(), late_us.end())));
  }
  return left_out;
}

}  // namespace ledgerline::timing
