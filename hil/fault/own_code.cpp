#include "hil/fault/own_code.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <utility>

#include "common/base/text.hpp"
#include "common/process/children.hpp"
#include "ground/plugin/plugin.hpp"
#include "hil/fault/real/sdk_flight.hpp"
#include "hil/netem/text_parse.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {

Result<std::vector<std::string>> words_of_command(const std::string& line) {
  std::vector<std::string> words;
  std::string word;
  bool begun = false;
  char quote = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '\\' && quote != '\'' && i + 1 < line.size()) {
      word += line[++i];
      begun = true;
    } else if (quote != 0) {
      if (c == quote) {
        quote = 0;
      } else {
        word += c;
      }
    } else if (c == '"' || c == '\'') {
      quote = c;
      begun = true;
    } else if (c == ' ' || c == '\t') {
      if (begun) words.push_back(std::exchange(word, {}));
      begun = false;
    } else {
      word += c;
      begun = true;
    }
  }
  if (quote != 0) return Error{fmt::format("\"{}\": the quote {} has no end", line, quote)};
  if (begun) words.push_back(word);
  if (words.empty()) return Error{"an empty command names no program"};
  return words;
}

Result<std::string> program_at(const std::string& name) {
  if (name.find('/') != std::string::npos) {
    if (::access(name.c_str(), X_OK) == 0) return name;
    return Error{fmt::format("{} is no program that can be run", name)};
  }
  if (std::string file = find_program(name); !file.empty()) return file;
  return Error{fmt::format("there is no program {} in PATH", name)};
}

Status check_sitl(const Script& script) {
  const bool flown = script.kind == FlightKind::path || !script.pilot.empty();
  if (flown) return done;
  const bool manual = script.kind == FlightKind::manual;
  return Error{
      fmt::format("{}: flight.kind = \"{}\" is flown by a program of yours, in real time: give --program COMMAND{} "
                  "(docs/faults.md)",
                  script.name, name_of(script.kind), manual ? ", or rows [[pilot]] for simulated time" : "")};
}

Status put_into(Script& script, const OwnCode& own) {
  if (!own.controller.empty()) {
    if (script.kind != FlightKind::path)
      return Error{fmt::format("{}: --controller steers along a path, and flight.kind = \"{}\" has none", script.name,
                               name_of(script.kind))};
    auto loaded = ground::load_controller(own.controller);
    if (!loaded) return loaded.error();
    script.flight.follower = std::move(*loaded);
  }
  if (own.program.empty()) return done;
  if (const auto program = program_at(own.program.front()); !program) return program.error();
  if (script.kind == FlightKind::path)
    return Error{fmt::format("{}: --program flies scripts of flight.kind = \"manual\" or \"sdk\"; here ground flies",
                             script.name)};
  if (!script.pilot.empty())
    return Error{fmt::format("{}: it has a [[pilot]], who and --program would fly the same drones", script.name)};
  if (script.kind == FlightKind::sdk) return check_sdk(script);
  return done;
}

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

void OwnProgram::add_line(const std::string& line) {
  written_ += line.size() + 1;
  if (written_ > max_output) return;
  output_ << line << '\n' << std::flush;
}

void OwnProgram::end() {
  if (!started_) return;
  if (is_running()) {
    ended_here_ = true;
    children_.stop(name, program_timeout_ns);
  }
  // What it started would fly the next flight, too.
  children_.signal_group(name, SIGKILL);
}

Verdict OwnProgram::verdict(TimeNs at_ns) const {
  Verdict verdict = always("your program ends by itself, with exit code 0");
  if (!started_) {
    verdict.broke(at_ns, "it was never started");
  } else if (ended_here_) {
    verdict.broke(at_ns, "it still ran when the flight's time was up");
  } else if (!children_.has_succeeded(name)) {
    std::string what = "it " + children_.how_it_ended(name);
    const std::string tail = children_.log_tail(name, 3);
    for (const std::string_view line : split(tail, '\n')) {  // printable() is for one line
      if (!line.empty()) what += "\n" + printable(line);
    }
    verdict.broke(at_ns, what);
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
