#include "tools/tello/core/asking.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "common/base/text.hpp"

namespace ledgerline::tello {
namespace {

std::string or_silent(const std::string& answer, const char* unit = "") {
  return answer.empty() ? "does not say" : answer + unit;
}

nlohmann::json or_null(const std::string& answer) { return answer.empty() ? nlohmann::json() : nlohmann::json(answer); }

}  // namespace

const std::vector<std::string>& questions_of_info() {
  static const std::vector<std::string> questions{"sn?", "battery?", "hardware?", "sdk?", "version?", "wifiversion?"};
  return questions;
}

std::string words(const std::vector<Found>& drones) {
  constexpr const char* row = "{:<15}  {:<16}  {:<12}  {:<12}  {:<12}  {}\n";
  std::string out = fmt::format(row, "ADDRESS", "SERIAL", "BATTERY", "SDK", "HARDWARE", "FIRMWARE");
  for (const Found& drone : drones) {
    const Asking& asking = drone.asking;
    const std::string version = asking.answer("version?");
    out += fmt::format(row, ipv4_text(drone.address), or_silent(asking.answer("sn?")),
                       or_silent(asking.answer("battery?"), " %"), or_silent(asking.answer("sdk?")),
                       or_silent(asking.answer("hardware?")),
                       or_silent(version.empty() ? asking.answer("wifiversion?") : version));
  }
  out.pop_back();
  return out;
}

std::string json(const std::vector<Found>& drones) {
  nlohmann::json list = nlohmann::json::array();
  for (const Found& drone : drones) {
    const Asking& asking = drone.asking;
    const std::string battery = asking.answer("battery?");
    list.push_back({{"address", ipv4_text(drone.address)},
                    {"serial", or_null(asking.answer("sn?"))},
                    {"battery", battery.empty() ? nlohmann::json() : nlohmann::json(std::stoi(battery))},
                    {"sdk", or_null(asking.answer("sdk?"))},
                    {"hardware", or_null(asking.answer("hardware?"))},
                    {"version", or_null(asking.answer("version?"))},
                    {"wifi_version", or_null(asking.answer("wifiversion?"))}});
  }
  return nlohmann::json{{"drones", list}}.dump();
}

}  // namespace ledgerline::tello
