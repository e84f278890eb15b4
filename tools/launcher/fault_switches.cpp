#include "tools/launcher/fault_switches.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/text.hpp"
#include "common/rt/clock.hpp"
#include "hil/proxy/switches.hpp"

namespace ledgerline::launcher {

FaultSwitches::FaultSwitches(const std::vector<std::string>& drones) {
  // Less than would make commands too old to be flown ([check] max_age_ms).
  all_.push_back({.name = "ledger-delayed",
                  .drone = "",
                  .label = "Ledger delayed",
                  .words = "The drones' host reaches its ledger, and hears of it, 0.1 s later each way.",
                  .line = "server agent* both delay 100ms"});
  all_.push_back({.name = "ledger-stalled",
                  .drone = "",
                  .label = "Ledger stalled",
                  .words = "Nobody reaches the ledger: drones fly their plans to the end, hover, and land after 5 s.",
                  .line = "server * both stall"});
  for (const std::string& drone : drones) {
    // Lost, and not held back as by a stall: what a radio did not carry does not come later.
    all_.push_back({.name = "silent-" + drone,
                    .drone = drone,
                    .label = "Drone silent",
                    .words = "Nothing that it says arrives: it is braked, hovers without state, and lands after 5 s.",
                    .line = fmt::format("drone {} from partition", drone)});
    all_.push_back(
        {.name = "commands-lost-" + drone,
         .drone = drone,
         .label = "Commands lost",
         .words =
             "It hears nothing, a stop neither: it flies on with its last command, and lands by itself after 15 s.",
         .line = fmt::format("drone {} to partition", drone)});
  }
}

Result<std::optional<FaultSwitches::Step>> FaultSwitches::step_of(std::string_view command) const {
  using Found = std::optional<Step>;
  if (command == "list") return Found();
  const std::size_t space = std::min(command.find(' '), command.size());
  const std::string_view verb = command.substr(0, space);
  if (space == command.size() || (verb != "on" && verb != "off"))
    return Error{fmt::format("\"{}\" is none of list, on NAME, off NAME", printable(std::string(command), 100))};
  const std::string_view name = command.substr(space + 1);
  const auto found = std::find_if(all_.begin(), all_.end(), [&](const Switch& one) { return one.name == name; });
  if (found == all_.end()) return Error{fmt::format("there is no switch \"{}\"", printable(std::string(name), 100))};
  if (verb == "on" && ended_) return Error{"the flight ends: nothing is switched on any more"};
  auto made = step(static_cast<std::size_t>(found - all_.begin()), verb == "on");
  if (!made) return made.error();
  return Found(std::move(*made));
}

Result<FaultSwitches::Step> FaultSwitches::step(std::size_t which, bool on) const {
  if (on) return Step{which, true, all_[which].line};
  auto off = hil::proxy::opposite(all_[which].line);
  if (!off) return off.error();
  return Step{which, false, std::move(*off)};
}

std::vector<FaultSwitches::Step> FaultSwitches::steps_off() const {
  std::vector<Step> steps;
  for (std::size_t i = 0; i < all_.size(); ++i) {
    if (!all_[i].may_be_on) continue;
    if (auto off = step(i, false)) steps.push_back(std::move(*off));
  }
  return steps;
}

std::string FaultSwitches::list() const {
  nlohmann::json list = nlohmann::json::array();
  for (const Switch& one : all_) {
    list.push_back(
        {{"name", one.name}, {"drone", one.drone}, {"label", one.label}, {"words", one.words}, {"on", one.on}});
  }
  return nlohmann::json{{"faults", std::move(list)}}.dump() + "\n";
}

namespace {

constexpr int look_ms = 50;  // at what the launcher wants
constexpr TimeNs proxy_timeout_ns = ns_per_s;

}  // namespace

Result<std::unique_ptr<SwitchService>> SwitchService::open(const std::string& socket, std::string proxy,
                                                           const std::vector<std::string>& drones) {
  auto opened = CommandSocket::open(socket);
  if (!opened) return opened.error();
  return std::unique_ptr<SwitchService>(new SwitchService(std::move(*opened), std::move(proxy), drones));
}

SwitchService::SwitchService(CommandSocket socket, std::string proxy, const std::vector<std::string>& drones)
    : socket_(std::move(socket)), proxy_(std::move(proxy)), switches_(drones), thread_([this] { serve(); }) {}

SwitchService::~SwitchService() {
  over_ = true;
  thread_.join();
}

void SwitchService::serve() {
  std::vector<pollfd> polled;
  while (!over_) {
    if (ending_) switches_.end();
    if (off_.exchange(false) || ending_) switch_off();
    polled.clear();
    socket_.add_to(monotonic_ns(), polled);
    ::poll(polled.data(), polled.size(), look_ms);
    socket_.serve(monotonic_ns(), polled, [this](const std::string& command) { return act(command); });
  }
  switch_off();
}

Result<std::string> SwitchService::act(const std::string& command) {
  const auto step = switches_.step_of(command);
  if (!step) return step.error();
  if (*step) {
    switches_.on_sent(**step);
    if (const auto reported = send_command(proxy_, (*step)->line, proxy_timeout_ns); !reported) return reported.error();
    switches_.on_done(**step);
  }
  return switches_.list();
}

// One that is not switched off stays on the list, and is tried again.
void SwitchService::switch_off() {
  for (const FaultSwitches::Step& step : switches_.steps_off()) {
    if (!send_command(proxy_, step.line, proxy_timeout_ns)) return;
    switches_.on_done(step);
  }
}

}  // namespace ledgerline::launcher
