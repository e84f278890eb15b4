#include "tools/timing/usage.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace ledgerline {
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ThreadUsage, program, name, process, thread, user_s, system_s, cpu_s, waited_s,
                                   voluntary, involuntary, minor_faults, major_faults, policy, priority)
}
namespace ledgerline::timing {
namespace {

using nlohmann::json;

json to_json(const Snapshot& snapshot) {
  return {{"t_ns", snapshot.t_ns},
          {"busy_s", snapshot.host.busy_s},
          {"steal_s", snapshot.host.steal_s},
          {"threads", snapshot.threads}};
}

Snapshot snapshot_from(const json& j) {
  Snapshot snapshot;
  j.at("t_ns").get_to(snapshot.t_ns);
  j.at("busy_s").get_to(snapshot.host.busy_s);
  j.at("steal_s").get_to(snapshot.host.steal_s);
  j.at("threads").get_to(snapshot.threads);
  return snapshot;
}

/// Of a number with a fraction, or beyond 64 bits, JSON's reader would make an integer that is undefined.
bool is_whole(const json& number) { return number.is_number_integer(); }
bool counts_are_whole(const json& snapshot) {
  if (!is_whole(snapshot.at("t_ns"))) return false;
  for (const json& thread : snapshot.at("threads")) {
    for (const char* count :
         {"process", "thread", "voluntary", "involuntary", "minor_faults", "major_faults", "policy", "priority"}) {
      if (!is_whole(thread.at(count))) return false;
    }
  }
  return true;
}

// Counters of the kernel only grow; where they did not, the thread's number was given to another.
std::uint64_t grown(std::uint64_t from, std::uint64_t to) { return to >= from ? to - from : to; }
double grown(double from, double to) { return to >= from ? to - from : to; }

}  // namespace

Snapshot read_snapshot(const std::map<std::string, pid_t>& programs) {
  Snapshot snapshot;
  snapshot.t_ns = monotonic_ns();
  snapshot.host = read_host();
  for (const auto& [name, pid] : programs) {
    auto threads = read_threads(name, pid);
    std::move(threads.begin(), threads.end(), std::back_inserter(snapshot.threads));
  }
  return snapshot;
}

json to_json(const UsageRecord& record) {
  return {{"programs", record.programs}, {"begin", to_json(record.begin)}, {"end", to_json(record.end)}};
}

Result<UsageRecord> usage_from_json(const std::string& text) {
  const json j = json::parse(text, nullptr, false);
  if (j.is_discarded()) return Error{"it is no JSON"};  // the parser's own words would have the damaged bytes in them
  try {
    UsageRecord record;
    if (!std::ranges::all_of(j.at("programs"), is_whole)) return Error{"the number of a process in it is not whole"};
    j.at("programs").get_to(record.programs);
    if (!counts_are_whole(j.at("begin")) || !counts_are_whole(j.at("end"))) return Error{"a count in it is not whole"};
    record.begin = snapshot_from(j.at("begin"));
    record.end = snapshot_from(j.at("end"));
    for (const Snapshot* snapshot : {&record.begin, &record.end}) {
      if (snapshot->t_ns < 0 || snapshot->t_ns > INT64_MAX / 2) return Error{"a time in it cannot be"};
    }
    return record;
  } catch (const json::exception& e) {
    return Error{std::string("not what fly writes: ") + e.what()};
  }
}

double Load::used_percent() const {
  double sum = 0;
  for (const auto& [name, percent] : programs) sum += percent;
  return sum;
}

Load load_between(const Snapshot& begin, const Snapshot& end) {
  Load load;
  load.seconds = to_seconds(end.t_ns - begin.t_ns);
  if (!(load.seconds > 0)) return {};
  load.host_percent = 100 * grown(begin.host.busy_s, end.host.busy_s) / load.seconds;
  load.steal_s = grown(begin.host.steal_s, end.host.steal_s);
  for (const ThreadUsage& now : end.threads) {
    const auto before = std::find_if(begin.threads.begin(), begin.threads.end(), [&](const ThreadUsage& t) {
      return t.thread == now.thread && t.program == now.program;
    });
    const ThreadUsage zero{};
    const ThreadUsage& was = before == begin.threads.end() ? zero : *before;
    ThreadLoad thread{now, 0};
    ThreadUsage& who = thread.who;
    for (const auto time : {&ThreadUsage::user_s, &ThreadUsage::system_s, &ThreadUsage::cpu_s, &ThreadUsage::waited_s})
      who.*time = grown(was.*time, now.*time);
    for (const auto count :
         {&ThreadUsage::voluntary, &ThreadUsage::involuntary, &ThreadUsage::minor_faults, &ThreadUsage::major_faults})
      who.*count = grown(was.*count, now.*count);
    thread.cpu_percent = 100 * who.cpu_s / load.seconds;
    load.programs[now.program.substr(0, now.program.find('/'))] += thread.cpu_percent;
    load.threads.push_back(std::move(thread));
  }
  std::stable_sort(load.threads.begin(), load.threads.end(),
                   [](const ThreadLoad& a, const ThreadLoad& b) { return a.cpu_percent > b.cpu_percent; });
  return load;
}

}  // namespace ledgerline::timing
