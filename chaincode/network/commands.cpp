#include "chaincode/network/commands.hpp"

#include <fmt/format.h>

#include <csignal>
#include <map>

#include "common/process/children.hpp"

namespace ledgerline::fabric_network {
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

}  // namespace ledgerline::fabric_network
