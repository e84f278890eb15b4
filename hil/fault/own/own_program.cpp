#include "hil/fault/own/own_program.hpp"

#include <fmt/format.h>

#include <csignal>
#include <cstdlib>

#include "common/base/printable.hpp"
#include "hil/fault/own/own_code.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs program_timeout_ns = 3 * ns_per_s;
constexpr const char* loopback =
    R"(<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General></Domain></CycloneDDS>)";

}  // namespace

Status OwnProgram::start(const std::vector<std::string>& before, const std::vector<std::string>& environment) {
  output_.open(directory_ + "/program.out");
  if (!output_) return Error{fmt::format("cannot write {}/program.out", directory_)};
  const auto program = program_at(command_.front());
  if (!program) return program.error();
  std::vector<std::string> command = before;
  command.push_back(*program);
  command.insert(command.end(), command_.begin() + 1, command_.end());
  started_ = true;
  return children_.start({name, std::move(command), directory_ + "/program.log", SIGTERM, environment});
}

void OwnProgram::take_line(const std::string& line) {
  written_ += line.size() + 1;
  if (written_ > max_output) return;
  output_ << line << '\n' << std::flush;
}

void OwnProgram::end() {
  if (!started_) return;
  if (running()) {
    ended_here_ = true;
    children_.stop(name, program_timeout_ns);
  }
  // What it started would fly the next flight, too.
  children_.signal_group(name, SIGKILL);
}

Verdict OwnProgram::verdict(TimeNs at_ns) const {
  Verdict verdict;
  verdict.rule.text = "your program ends by itself, with exit code 0";
  verdict.rule.always = true;
  if (!started_) {
    verdict.broke(at_ns, "it was never started");
  } else if (ended_here_) {
    verdict.broke(at_ns, "it still ran when the flight's time was up");
  } else if (!children_.ended_well(name)) {
    verdict.broke(at_ns,
                  fmt::format("it {}: {}", children_.how_it_ended(name), printable(children_.log_tail(name, 3))));
  }
  return verdict;
}

std::vector<std::string> topics_environment(int drones) {
  std::string names;
  for (int k = 1; k <= drones; ++k) names += (k > 1 ? "," : "") + drone_name(k);
  std::vector<std::string> environment{"LEDGERLINE_DRONES=" + names};
  if (!std::getenv("ROS_LOCALHOST_ONLY")) environment.emplace_back("ROS_LOCALHOST_ONLY=1");
  if (!std::getenv("CYCLONEDDS_URI")) environment.push_back(fmt::format("CYCLONEDDS_URI={}", loopback));
  return environment;
}

}  // namespace ledgerline::hil
