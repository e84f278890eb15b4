#include "chaincode/network/processes/processes.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <csignal>
#include <filesystem>
#include <map>
#include <utility>

#include "common/base/log.hpp"
#include "common/process/children.hpp"

namespace ledgerline::network {

namespace {

constexpr TimeNs command_limit_ns = 60 * ns_per_s, stop_timeout_ns = 5 * ns_per_s;
constexpr int log_lines = 10;
constexpr std::size_t output_kept = 1 << 16;  // of a service; commands print a few lines

}  // namespace

Processes::Processes(std::string logs, Restarts::Limits limits)
    : logs_(std::move(logs)), limits_(limits), children_([this](const std::string& name, const std::string& line) {
        std::string& all = output_[name];
        if (all.size() + line.size() < output_kept) all += line + "\n";
      }) {}

Status Processes::start(const std::string& name, const std::string& address, std::vector<std::string> command,
                        std::vector<std::string> environment, Scheduling scheduling) {
  services_.push_back({name, address, std::move(command), std::move(environment), scheduling,
                       Restarts(limits_, static_cast<std::uint64_t>(realtime_ns()) + services_.size())});
  return launch(services_.back());
}

Status Processes::launch(const Service& service) {
  return children_.start(
      {service.name, service.command, log_of(service.name), SIGTERM, service.environment, service.scheduling});
}

Status Processes::poll(TimeNs duration) {
  const TimeNs until = monotonic_ns() + duration;
  do {
    children_.poll(std::min<TimeNs>(std::max<TimeNs>(until - monotonic_ns(), 0), 50 * ns_per_ms));
    for (Service& service : services_) {
      if (children_.is_running(service.name)) continue;
      if (Status s = restart_ended(service); !s) return s;
    }
  } while (monotonic_ns() < until);
  return done;
}

/// It does not run.
Status Processes::restart_ended(Service& service) {
  const TimeNs now = monotonic_ns();
  if (service.start_at == 0) {
    const std::string how = fmt::format("{} {}", service.name, children_.how_it_ended(service.name));
    const std::string end =
        fmt::format("The end of {}:\n{}", log_of(service.name), children_.log_tail(service.name, log_lines));
    if (!supervising_) return Error{how + ". " + end};
    const auto at = service.restarts.ended(now);
    const Restarts::Limits& limits = service.restarts.limits();
    if (!at) {
      return Error{fmt::format("{}, more than {} times within {:.0f} s: it is given up. {}", how, limits.max_restarts,
                               to_seconds(limits.within), end)};
    }
    service.start_at = *at;
    spdlog::warn("{}; it starts again in {:.0f} ms (restart {})", how, to_ms(*at - now), service.restarts.count());
  }
  if (now < service.start_at) return done;
  service.start_at = 0;
  return launch(service);
}

void Processes::kill(const std::string& name) { children_.signal(name, SIGKILL); }

bool Processes::stop() {
  bool in_time = true;
  for (auto s = services_.rbegin(); s != services_.rend(); ++s) children_.signal(s->name, SIGTERM);
  for (auto s = services_.rbegin(); s != services_.rend(); ++s) {
    in_time = children_.stop(s->name, stop_timeout_ns) && in_time;
  }
  services_.clear();
  return in_time;
}

Result<std::string> Processes::run(const std::string& what, std::vector<std::string> command,
                                   std::vector<std::string> environment) {
  const std::string name = fmt::format("command{}", ++commands_);
  std::error_code error;
  std::filesystem::remove(log_of(name), error);  // of an earlier run: what is there is shown as this one's
  if (Status s = children_.start({name, std::move(command), log_of(name), SIGTERM, std::move(environment)}); !s) {
    return s.error();
  }
  const TimeNs until = monotonic_ns() + command_limit_ns;
  while (children_.is_running(name)) {
    if (monotonic_ns() > until) {
      children_.stop(name, ns_per_s);
      return Error{fmt::format("{}: no end after {:.0f} s", what, to_seconds(command_limit_ns))};
    }
    children_.poll(10 * ns_per_ms);
  }
  const std::string printed = std::exchange(output_[name], {});
  if (!children_.has_succeeded(name)) {
    return Error{
        fmt::format("{} {}:\n{}{}", what, children_.how_it_ended(name), printed, children_.log_tail(name, log_lines))};
  }
  std::filesystem::remove(log_of(name), error);
  return printed;
}

Status Processes::run_until_good(const std::string& what, const std::vector<std::string>& command,
                                 const std::vector<std::string>& environment, TimeNs limit,
                                 const std::string& good_too) {
  const TimeNs until = monotonic_ns() + limit;
  for (TimeNs wait = 20 * ns_per_ms;; wait = std::min(2 * wait, ns_per_s / 2)) {
    const auto printed = run(what, command, environment);
    if (printed || (!good_too.empty() && printed.error().message.find(good_too) != std::string::npos)) return done;
    if (Status s = poll(wait); !s) return s;
    if (monotonic_ns() > until) return printed.error();
  }
}

std::vector<Processes::State> Processes::states() const {
  std::vector<State> all;
  for (const Service& s : services_) {
    all.push_back({s.name, s.address, children_.pid(s.name), s.restarts.count(), children_.cpu_seconds(s.name)});
  }
  return all;
}

bool Processes::has_printed(const std::string& name, const std::string& text) const {
  const auto found = output_.find(name);
  return found != output_.end() && found->second.find(text) != std::string::npos;
}

namespace {

constexpr TimeNs each_command_limit_ns = 60 * ns_per_s;
constexpr int lines_of_a_failure = 10;

class Lanes {
 public:
  Lanes(const std::vector<std::vector<Command>>& lanes, std::vector<std::string> logs)
      : lanes_(lanes),
        logs_(std::move(logs)),
        next_(lanes.size(), 0),
        since_ns_(lanes.size(), 0),
        children_([this](const std::string& name, const std::string& line) { output_[name] += line + "\n"; }) {}

  Result<std::vector<std::string>> run() {
    for (std::size_t lane = 0; lane < lanes_.size(); ++lane) {
      if (Status s = start(lane); !s) return s.error();
    }
    for (;;) {
      std::size_t busy = 0;
      for (std::size_t lane = 0; lane < lanes_.size(); ++lane) {
        if (next_[lane] == lanes_[lane].size()) continue;
        if (Status s = advance(lane); !s) return s.error();
        busy += next_[lane] < lanes_[lane].size() ? 1 : 0;
      }
      if (busy == 0) break;
      children_.poll(10 * ns_per_ms);
    }
    std::vector<std::string> printed;
    for (std::size_t lane = 0; lane < lanes_.size(); ++lane) printed.push_back(output_[name_of(lane)]);
    return printed;
  }

 private:
  static std::string name_of(std::size_t lane) { return fmt::format("lane{}", lane); }

  Status start(std::size_t lane) {
    if (next_[lane] == lanes_[lane].size()) return done;
    const Command& command = lanes_[lane][next_[lane]];
    output_[name_of(lane)].clear();
    since_ns_[lane] = monotonic_ns();
    return children_.start({name_of(lane), command.words, logs_[lane], SIGTERM, command.environment});
  }

  Status advance(std::size_t lane) {
    const Command& command = lanes_[lane][next_[lane]];
    const std::string name = name_of(lane);
    if (children_.is_running(name)) {
      if (monotonic_ns() - since_ns_[lane] < each_command_limit_ns) return done;
      return Error{fmt::format("{}: no end after {:.0f} s", command.what, to_seconds(each_command_limit_ns))};
    }
    if (!children_.has_succeeded(name)) {
      return Error{fmt::format("{} {}. The end of {}:\n{}", command.what, children_.how_it_ended(name), logs_[lane],
                               children_.log_tail(name, lines_of_a_failure))};
    }
    ++next_[lane];
    return start(lane);
  }

  const std::vector<std::vector<Command>>& lanes_;
  const std::vector<std::string> logs_;
  std::vector<std::size_t> next_;
  std::vector<TimeNs> since_ns_;
  std::map<std::string, std::string> output_;
  Children children_;
};

}  // namespace

Result<std::vector<std::string>> run_lanes(const std::vector<std::vector<Command>>& lanes,
                                           const std::string& log_stem) {
  std::vector<std::string> logs;
  for (std::size_t lane = 0; lane < lanes.size(); ++lane) logs.push_back(fmt::format("{}-{}.log", log_stem, lane));
  return Lanes(lanes, std::move(logs)).run();
}

Result<std::string> run_command(const Command& command, const std::string& log) {
  const auto printed = Lanes({{command}}, {log}).run();
  if (!printed) return printed.error();
  return printed->front();
}

}  // namespace ledgerline::network
