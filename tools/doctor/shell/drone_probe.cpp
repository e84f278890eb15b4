#include "tools/doctor/shell/drone_probe.hpp"

#include <charconv>

#include "common/base/ipv4.hpp"
#include "tools/doctor/shell/host_probe.hpp"
#include "tools/tello/shell/talk.hpp"

namespace ledgerline::doctor {
namespace {

std::optional<double> battery_in(const std::string& answer) {
  int percent = 0;
  const auto [end, error] = std::from_chars(answer.data(), answer.data() + answer.size(), percent);
  if (error != std::errc() || percent < 0 || percent > 100) return std::nullopt;
  return percent / 100.0;
}

}  // namespace

Findings ask_drones(const ProgramConfig& link) {
  constexpr const char* check = "drone";
  if (link_runs()) return {found(Problem::drones_in_use, check, link.path)};
  Findings out;
  for (const DroneKeys& drone : link.drones) {
    const auto address = parse_ipv4(drone.address);
    if (!address) continue;  // link's own reader has said so
    std::vector<tello::Found> asked{{*address, tello::Asking({"battery?"})}};
    if (auto status = tello::ask(asked, drone.interface); !status) {
      out.push_back(found(Problem::drone_silent, check, drone.name + ": " + status.error().what));
      continue;
    }
    DroneFacts facts{.name = drone.name, .address = drone.address, .battery_low = link.battery_low};
    facts.there = asked[0].asking.present();
    facts.battery = battery_in(asked[0].asking.answer("battery?"));
    for (Finding& one : judge(facts)) out.push_back(std::move(one));
  }
  return out;
}

}  // namespace ledgerline::doctor
