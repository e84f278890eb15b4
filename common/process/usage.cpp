#include "common/process/usage.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <sstream>

namespace ledgerline {
namespace {

// Files of /proc end in the middle when their process does.
std::string text_of(const std::string& path) {
  std::ifstream file(path);
  std::string text, line;
  while (std::getline(file, line)) text += line + "\n";
  return text;
}

std::uint64_t number_behind(const std::string& text, const std::string& key) {
  const auto at = text.find("\n" + key);
  if (at == std::string::npos) return 0;
  std::istringstream in(text.substr(at + 1 + key.size()));
  std::uint64_t number = 0;
  in >> number;
  return number;
}

double ticks() { return static_cast<double>(::sysconf(_SC_CLK_TCK)); }

}  // namespace

std::optional<ThreadUsage> parse_thread(const std::string& stat, const std::string& status,
                                        const std::string& schedstat, double ticks_per_s) {
  const auto open = stat.find('('), close = stat.rfind(')');
  if (open == std::string::npos || close == std::string::npos || close < open) return std::nullopt;
  ThreadUsage usage;
  usage.name = stat.substr(open + 1, close - open - 1);
  std::istringstream in(stat.substr(close + 1));
  // Field k of proc(5) is fields[k - 3].
  const std::vector<std::string> fields{std::istream_iterator<std::string>(in), {}};
  constexpr std::size_t least = 39;
  if (fields.size() < least) return std::nullopt;
  const auto field = [&](std::size_t k) { return std::strtoull(fields[k - 3].c_str(), nullptr, 10); };
  usage.minor_faults = field(10);
  usage.major_faults = field(12);
  usage.user_s = static_cast<double>(field(14)) / ticks_per_s;
  usage.system_s = static_cast<double>(field(15)) / ticks_per_s;
  usage.priority = static_cast<int>(field(40));
  usage.policy = static_cast<int>(field(41));
  usage.voluntary = number_behind(status, "voluntary_ctxt_switches:");
  usage.involuntary = number_behind(status, "nonvoluntary_ctxt_switches:");
  usage.cpu_s = usage.user_s + usage.system_s;
  std::istringstream exact(schedstat);
  if (double run_ns = 0, wait_ns = 0; exact >> run_ns >> wait_ns) {
    usage.cpu_s = run_ns * 1e-9;
    usage.waited_s = wait_ns * 1e-9;
  }
  return usage;
}

std::optional<HostUsage> parse_host(const std::string& stat, const std::string& cpu, double ticks_per_s) {
  std::istringstream lines(stat);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream in(line);
    std::string name;
    double user = 0, nice = 0, system = 0, idle = 0, iowait = 0, irq = 0, softirq = 0, steal = 0;
    if (!(in >> name) || name != cpu) continue;
    if (!(in >> user >> nice >> system >> idle >> iowait >> irq >> softirq >> steal)) return std::nullopt;
    return HostUsage{(user + nice + system + irq + softirq) / ticks_per_s, steal / ticks_per_s};
  }
  return std::nullopt;
}

std::vector<ThreadUsage> read_threads(const std::string& program, pid_t process) {
  namespace fs = std::filesystem;
  std::vector<ThreadUsage> threads;
  std::error_code error;
  fs::directory_iterator tasks(fmt::format("/proc/{}/task", process), error);
  for (; !error && tasks != fs::directory_iterator(); tasks.increment(error)) {
    const std::string task = tasks->path();
    auto usage =
        parse_thread(text_of(task + "/stat"), text_of(task + "/status"), text_of(task + "/schedstat"), ticks());
    if (!usage) continue;
    usage->program = program;
    usage->process = process;
    usage->thread = static_cast<pid_t>(std::strtol(tasks->path().filename().c_str(), nullptr, 10));
    threads.push_back(std::move(*usage));
    std::istringstream children(text_of(task + "/children"));
    for (pid_t child = 0; children >> child;) {
      std::string name = text_of(fmt::format("/proc/{}/comm", child));
      while (!name.empty() && name.back() == '\n') name.pop_back();
      const auto more = read_threads(program.substr(0, program.find('/')) + "/" + name, child);
      threads.insert(threads.end(), more.begin(), more.end());
    }
  }
  return threads;
}

HostUsage read_host(const std::string& cpu) {
  return parse_host(text_of("/proc/stat"), cpu, ticks()).value_or(HostUsage{});
}

std::vector<pid_t> process_tree(pid_t root) {
  namespace fs = std::filesystem;
  std::map<pid_t, pid_t> parents;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    const pid_t pid = std::atoi(entry.path().filename().c_str());
    const std::string stat = pid > 0 ? text_of(entry.path() / "stat") : "";
    const std::size_t name_end = stat.rfind(')');  // a name may have blanks in it
    if (name_end != std::string::npos && name_end + 4 < stat.size())
      parents[pid] = std::atoi(stat.c_str() + name_end + 4);  // ") S PARENT"
  }
  std::vector<pid_t> tree;
  for (const auto& [pid, parent] : parents) {
    pid_t above = pid;
    while (above > 1 && above != root && parents.contains(above)) above = parents[above];
    if (above == root) tree.push_back(pid);
  }
  return tree;
}

std::uint64_t available_memory() { return number_behind(text_of("/proc/meminfo"), "MemAvailable:") * 1'024; }

double cpu_seconds_of(pid_t process) {
  const auto usage = parse_thread(text_of(fmt::format("/proc/{}/stat", process)), "", "", ticks());
  double sum = usage ? usage->cpu_s : 0;
  std::istringstream children(text_of(fmt::format("/proc/{0}/task/{0}/children", process)));
  for (pid_t child = 0; children >> child;) sum += cpu_seconds_of(child);
  return sum;
}

double memory_mb_of(pid_t process) {
  constexpr double kb_per_mb = 1e6 / 1024;
  std::uint64_t kb = number_behind(text_of(fmt::format("/proc/{}/smaps_rollup", process)), "Pss:");
  // Of a program with keys root alone reads that (keep_memory_private()); this counts what is shared as well.
  if (kb == 0) kb = number_behind(text_of(fmt::format("/proc/{}/status", process)), "VmRSS:");
  double sum = static_cast<double>(kb) / kb_per_mb;
  std::istringstream children(text_of(fmt::format("/proc/{0}/task/{0}/children", process)));
  for (pid_t child = 0; children >> child;) sum += memory_mb_of(child);
  return sum;
}

}  // namespace ledgerline
