#include "tools/timing/show.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "common/rt/loop_ticker.hpp"
#include "tools/timing/figures.hpp"

namespace ledgerline::timing {
namespace {

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
  void name(int process, const std::string& text) {
    add("M", "process_name", process, 0, 0, fmt::format(R"(,"args":{{"name":"{}"}})", text));
  }

 private:
  std::ostream& out_;
  bool first_ = true;
};

std::string duration(TimeNs ns) { return fmt::format(R"(,"dur":{}.{:03})", ns / ns_per_us, ns % ns_per_us); }

void add_walk(Events& events, const Walk& walk, std::size_t lane) {
  const TimeNs begin_ns = walk.at(Mark::sampled), end_ns = walk.at(walk.last());
  events.add("X", "sample", walk.drone, lane, begin_ns,
             duration(end_ns - begin_ns) + fmt::format(R"(,"args":{{"sequence":{}}})", walk.sequence));
  for (const Stage& stage : stages) {
    if (!walk.has(stage.from) || !walk.has(stage.to)) continue;
    events.add("X", stage.name, walk.drone, lane, walk.at(stage.from),
               duration(walk.at(stage.to) - walk.at(stage.from)));
  }
}

}  // namespace

std::size_t write_perfetto(std::ostream& out, std::span<const Walk> walks, std::span<const TraceRecord> loop_turns,
                           std::size_t max_walks) {
  const std::size_t left_out = walks.size() - std::min(max_walks, walks.size());
  walks = walks.subspan(left_out);
  Events events(out);
  std::map<int, std::vector<TimeNs>> lanes;  // of each drone: until when each is taken
  for (const Walk& walk : walks) {
    if (!lanes.contains(walk.drone)) events.name(walk.drone, fmt::format("tello{}", walk.drone));
    std::vector<TimeNs>& taken = lanes[walk.drone];
    const auto free =
        std::find_if(taken.begin(), taken.end(), [&](TimeNs until) { return until <= walk.at(Mark::sampled); });
    const auto lane = static_cast<std::size_t>(free - taken.begin());
    if (free == taken.end()) taken.push_back(0);
    taken[lane] = walk.at(walk.last());
    add_walk(events, walk, lane + 1);
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
