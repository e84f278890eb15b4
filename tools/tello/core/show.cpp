#include "tools/tello/core/dialogue.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "common/base/ipv4.hpp"

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
    const Dialogue& dialogue = drone.dialogue;
    const std::string version = dialogue.answer("version?");
    out += fmt::format(row, ipv4_text(drone.address), or_silent(dialogue.answer("sn?")),
                       or_silent(dialogue.answer("battery?"), " %"), or_silent(dialogue.answer("sdk?")),
                       or_silent(dialogue.answer("hardware?")),
                       or_silent(version.empty() ? dialogue.answer("wifiversion?") : version));
  }
  out.pop_back();
  return out;
}

std::string json(const std::vector<Found>& drones) {
  nlohmann::json list = nlohmann::json::array();
  for (const Found& drone : drones) {
    const Dialogue& dialogue = drone.dialogue;
    const std::string battery = dialogue.answer("battery?");
    list.push_back({{"address", ipv4_text(drone.address)},
                    {"serial", or_null(dialogue.answer("sn?"))},
                    {"battery", battery.empty() ? nlohmann::json() : nlohmann::json(std::stoi(battery))},
                    {"sdk", or_null(dialogue.answer("sdk?"))},
                    {"hardware", or_null(dialogue.answer("hardware?"))},
                    {"version", or_null(dialogue.answer("version?"))},
                    {"wifi_version", or_null(dialogue.answer("wifiversion?"))}});
  }
  return nlohmann::json{{"drones", list}}.dump();
}

}  // namespace ledgerline::tello
