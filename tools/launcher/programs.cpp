#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <fstream>

#include "common/base/check.hpp"
#include "tools/command/verbs.hpp"
#include "tools/launcher/launcher.hpp"

namespace ledgerline::launcher {
namespace {

using nlohmann::json;

constexpr TimeNs poll_ns = 50 * ns_per_ms;
constexpr TimeNs ready_limit_ns = 20 * ns_per_s, fabric_ready_limit_ns = 120 * ns_per_s;
constexpr int log_lines = 8;

// RouDi removes its shared memory when it is asked to end; nothing that the others hold outlives them.
// Fabric's network ends its own processes. Real drones stay in the air without their link: it lands them first.
int death_signal(const std::string& name, bool real_drones) {
  return name == "roudi" || name == "fabric" || (name == "link" && real_drones) ? SIGTERM : SIGKILL;
}

}  // namespace

Programs::Programs(const Options& options, const RunFiles& files, std::string folder,
                   const std::atomic<int>& interrupts,
                   std::function<void(const std::string& name, const json& message, const std::string& line)> on_line)
    : Children([this](const std::string& name, const std::string& line) { on_output(name, line); }),
      options_(options),
      files_(files),
      folder_(std::move(folder)),
      interrupts_(interrupts),
      on_line_(std::move(on_line)) {}

void Programs::on_output(const std::string& name, const std::string& line) {
  json message = json::parse(line, nullptr, false);
  if (!message.is_object()) message = json::object();
  if (message.value("ready", json()) == true) ready_[name] = line;
  on_line_(name, message, line);
}

Status Programs::start(const std::string& name, std::vector<std::string> arguments, const std::string& other_program) {
  // control-enroll and control-acquire are one program.
  const std::string program = other_program.empty() ? name.substr(0, name.find('-')) : other_program;
  const auto verb = std::ranges::find(command::verbs, program, &command::VerbRow::name);
  LEDGERLINE_CHECK(verb != command::verbs.end(), program);
  if (verb->program.empty())  // a service
    arguments.insert(arguments.begin(), folder_ + "/ledgerline-" + program);
  else
    arguments.insert(arguments.begin(), {folder_ + "/ledgerline", program});
  return Children::start({name, std::move(arguments), files_.log(name), death_signal(name, options_.own.has_value())});
}

Status Programs::check() const {
  if (interrupts_ > 0) return Error{"interrupted before take-off"};
  for (const std::string& name : names()) {
    if (is_running(name) || has_succeeded(name)) continue;
    return Error{name == controller_program(options_) ? why_controller_ended() : crash_of(name, "before take-off")};
  }
  return done;
}

Status Programs::wait_ready(const std::vector<std::string>& names) {
  const TimeNs limit_ns = options_.ledger == Ledger::fabric ? fabric_ready_limit_ns : ready_limit_ns;
  const TimeNs until_ns = monotonic_ns() + limit_ns;
  for (const std::string& name : names) {
    while (!is_ready(name)) {
      if (auto s = check(); !s) return s;
      if (!is_running(name) && !is_ready(name)) return Error{crash_of(name, "before take-off")};
      if (monotonic_ns() > until_ns) {
        return Error{fmt::format("{} was not ready within {:.0f} s. The end of {}:\n{}", name, to_seconds(limit_ns),
                                 files_.log(name), log_tail(name, log_lines))};
      }
      poll(poll_ns);
    }
  }
  return done;
}

Status Programs::run_to_end(const std::string& name, std::vector<std::string> arguments) {
  if (auto status = start(name, std::move(arguments)); !status) return status;
  return wait_for_end(name, "before take-off", [this] { return interrupts_ > 0; });
}

Status Programs::run_after_flight(const std::string& name, std::vector<std::string> arguments) {
  if (auto status = start(name, std::move(arguments)); !status) return status;
  const int interrupts_before = interrupts_;
  return wait_for_end(name, "after the flight", [this, interrupts_before] { return interrupts_ > interrupts_before; });
}

Status Programs::wait_for_end(const std::string& name, const std::string& when, const std::function<bool()>& gives_up) {
  const TimeNs until_ns = monotonic_ns() + ready_limit_ns;
  while (is_running(name)) {
    if (gives_up()) return Error{"interrupted " + when};
    if (monotonic_ns() > until_ns)
      return Error{fmt::format("{} did not end within {:.0f} s", name, to_seconds(ready_limit_ns))};
    poll(poll_ns);
  }
  if (!has_succeeded(name)) return Error{crash_of(name, when)};
  return done;
}

std::string Programs::crash_of(const std::string& name, const std::string& when) const {
  const std::string tail = log_tail(name, log_lines);
  return fmt::format("{} {} {}{}", name, how_it_ended(name), when,
                     tail.empty() ? fmt::format(" and logged nothing ({})", files_.log(name))
                                  : fmt::format(". The end of {}:\n{}", files_.log(name), tail));
}

std::string Programs::why_controller_ended() const {
  std::ifstream file(files_.summary(controller_program(options_)));
  const json summary = json::parse(file, nullptr, false);
  if (summary.is_object() && summary.contains("why") && summary["why"].is_string() && summary["why"] != "") {
    return summary["why"].get<std::string>();
  }
  return crash_of(controller_program(options_), "before every drone had finished its path and landed");
}

}  // namespace ledgerline::launcher
