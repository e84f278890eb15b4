#include "tools/status/core/status.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>

#include "common/base/text.hpp"
#include "tools/station/core/show.hpp"

namespace ledgerline::status {
namespace {

using station::Rows;

nlohmann::json text_or_null(const std::string& text) {
  return text.empty() ? nlohmann::json() : nlohmann::json(printable(text));
}

nlohmann::json seconds_or_null(const std::optional<TimeNs>& age_ns) {
  return age_ns ? nlohmann::json(std::round(to_seconds(*age_ns) * 1e3) / 1e3) : nlohmann::json();
}

std::string or_dash(const std::string& text) { return text.empty() ? "-" : printable(text); }
std::string or_dash(const std::optional<TimeNs>& age_ns) { return age_ns ? words_of_age(*age_ns) : "-"; }

std::string program_table(const std::vector<Program>& programs, const std::vector<NotRunning>& not_running) {
  if (programs.empty() && not_running.empty()) return "No program of Ledgerline runs on this host.\n";
  Rows rows{{"program", "pid", "user", "unit", "runs for", "config"}};
  bool replaced = false;
  for (const Program& one : programs) {
    rows.push_back({one.name + (one.halted ? " (stands still)" : "") + (one.replaced ? " *" : ""),
                    std::to_string(one.pid), or_dash(one.user), or_dash(one.unit), words_of_age(one.age_ns),
                    or_dash(one.config)});
    replaced = replaced || one.replaced;
  }
  for (const NotRunning& one : not_running)
    rows.push_back(
        {"ledgerline-" + one.program, "-", "-", "-", "-", fmt::format("not running ({})", printable(one.config))});
  return station::aligned(rows) +
         (replaced ? "* its file has been replaced: its next start brings what is there now\n" : "");
}

std::string ledger_table(const Ledger& ledger) {
  std::string text = fmt::format("\n{}: channel {}", printable(ledger.config), or_dash(ledger.channel));
  if (!ledger.why.empty()) return text + fmt::format(": {}\n", printable(ledger.why));
  text += fmt::format(", newest block {} old\n", or_dash(ledger.newest_block_age_ns));
  Rows peers{{"peer", "organisation", "height"}};
  for (const Peer& peer : ledger.peers)
    peers.push_back({or_dash(peer.endpoint), or_dash(peer.msp_id),
                     peer.height     ? std::to_string(*peer.height)
                     : peer.endorser ? "an endorser, which keeps no blocks"
                                     : printable(peer.why)});
  text += station::aligned(peers);
  if (ledger.drones.empty()) return text;
  Rows drones{{"drone", "state", "phase", "owner", "holder", "flown by", "stopped by"}};
  for (const Drone& drone : ledger.drones)
    drones.push_back({or_dash(drone.name), drone.why.empty() ? or_dash(drone.state_age_ns) : printable(drone.why),
                      or_dash(drone.phase), or_dash(drone.owner), or_dash(drone.holder),
                      or_dash(drone.delegate.empty() ? drone.holder : drone.delegate), or_dash(drone.stopped_by)});
  return text + station::aligned(drones);
}

}  // namespace

std::string words_of_age(TimeNs age_ns) {
  const double age_s = to_seconds(age_ns);
  if (std::abs(age_s) < 1) return fmt::format("{:.0f} ms", 1e3 * age_s);
  if (std::abs(age_s) < 100) return fmt::format("{:.1f} s", age_s);
  if (std::abs(age_s) < 6'000) return fmt::format("{:.0f} min", age_s / 60);
  if (std::abs(age_s) < 172'800) return fmt::format("{:.0f} h", age_s / 3'600);
  return fmt::format("{:.0f} d", age_s / 86'400);
}

std::string words(const Status& status) {
  std::string text = program_table(status.programs, status.not_running);
  for (const Ledger& ledger : status.ledgers) text += ledger_table(ledger);
  return text;
}

std::string to_json(const Status& status) {
  nlohmann::json programs = nlohmann::json::array(), not_running = programs, ledgers = programs;
  for (const Program& one : status.programs)
    programs.push_back({{"program", printable(one.name)},
                        {"pid", one.pid},
                        {"user", printable(one.user)},
                        {"unit", text_or_null(one.unit)},
                        {"config", text_or_null(one.config)},
                        {"age_s", seconds_or_null(one.age_ns)},
                        {"replaced", one.replaced},
                        {"halted", one.halted}});
  for (const NotRunning& one : status.not_running)
    not_running.push_back({{"program", "ledgerline-" + one.program}, {"config", printable(one.config)}});
  for (const Ledger& one : status.ledgers) {
    nlohmann::json peers = nlohmann::json::array(), drones = nlohmann::json::array();
    for (const Peer& peer : one.peers)
      peers.push_back({{"endpoint", printable(peer.endpoint)},
                       {"msp_id", text_or_null(peer.msp_id)},
                       {"height", peer.height ? nlohmann::json(*peer.height) : nlohmann::json()},
                       {"endorser", peer.endorser},
                       {"why", text_or_null(peer.why)}});
    for (const Drone& drone : one.drones)
      drones.push_back({{"drone", printable(drone.name)},
                        {"state_age_s", seconds_or_null(drone.state_age_ns)},
                        {"phase", text_or_null(drone.phase)},
                        {"owner", text_or_null(drone.owner)},
                        {"holder", text_or_null(drone.holder)},
                        {"delegate", text_or_null(drone.delegate)},
                        {"stopped_by", text_or_null(drone.stopped_by)},
                        {"why", text_or_null(drone.why)}});
    ledgers.push_back({{"config", printable(one.config)},
                       {"channel", text_or_null(one.channel)},
                       {"newest_block_age_s", seconds_or_null(one.newest_block_age_ns)},
                       {"why", text_or_null(one.why)},
                       {"peers", peers},
                       {"drones", drones}});
  }
  return nlohmann::json{{"programs", programs}, {"not_running", not_running}, {"ledgers", ledgers}}.dump();
}

bool all_well(const Status& status) {
  return status.not_running.empty() && std::ranges::all_of(status.ledgers, [](const Ledger& ledger) {
           return ledger.why.empty() && !ledger.peers.empty() &&
                  std::ranges::all_of(ledger.peers, [](const Peer& peer) { return peer.height || peer.endorser; });
         });
}

bool is_service(const std::string& program) {
  constexpr std::array services{"link", "agent", "ground", "bridge", "endorser"};
  return std::ranges::find(services, program) != services.end();
}

bool is_running(const std::vector<Program>& programs, const std::string& program, const std::string& config) {
  const std::filesystem::path wanted = config;
  return std::ranges::any_of(programs, [&](const Program& one) {
    const std::filesystem::path own = one.config;
    return one.name == "ledgerline-" + program && !one.halted &&
           (own.is_absolute() ? own == wanted : own.filename() == wanted.filename());
  });
}

std::vector<std::string> words_of(const std::string& cmdline) {
  std::vector<std::string> words;
  std::istringstream text(cmdline);
  for (std::string word; std::getline(text, word, '\0');) words.push_back(word);
  return words;
}

std::string value_of(const std::string& option, const std::vector<std::string>& words) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i] == option && i + 1 < words.size()) return words[i + 1];
    if (words[i].starts_with(option + "=")) return words[i].substr(option.size() + 1);
  }
  return {};
}

std::string unit_of(const std::string& cgroup) {
  std::istringstream lines(cgroup);
  for (std::string line; std::getline(lines, line);) {
    const std::string last = line.substr(line.rfind('/') + 1);
    if (last.ends_with(".service")) return last;
  }
  return {};
}

bool is_halted(const std::string& status) {
  constexpr std::string_view field = "\nState:\t";
  const auto at = status.find(field);
  return at != std::string::npos && at + field.size() < status.size() &&
         std::string_view("Tt").find(status[at + field.size()]) != std::string_view::npos;
}

std::optional<double> start_of(const std::string& stat, double ticks_per_s) {
  constexpr int start = 22, behind_name = 3;
  const auto name_end = stat.rfind(')');  // a name may have blanks and brackets
  if (name_end == std::string::npos) return std::nullopt;
  std::istringstream fields(stat.substr(name_end + 1));
  std::string field;
  for (int number = behind_name; number <= start; ++number) {
    if (!(fields >> field)) return std::nullopt;
  }
  if (field.find_first_not_of("0123456789") != std::string::npos || field.size() > 18) return std::nullopt;
  return std::stod(field) / ticks_per_s;
}

Executable executable_of(const std::string& link) {
  const std::string gone = " (deleted)";
  if (link.ends_with(gone)) return {link.substr(0, link.size() - gone.size()), true};
  return {link, false};
}

std::string name_of(const std::string& file, const std::vector<std::string>& words) {
  const std::filesystem::path path = file;
  const std::string name = path.filename();
  // In libexec, or its file may not be looked at: then this is the first word.
  const std::filesystem::path folder = path.parent_path();
  const bool is_group = folder.filename() == "ledgerline" && folder.parent_path().filename() == "libexec";
  const bool is_verb = name == "ledgerline" || (is_group && name.starts_with("ledgerline-"));
  if (is_verb) return words.size() > 1 ? "ledgerline " + words[1] : "";
  return name.starts_with("ledgerline-") ? name : "";
}

}  // namespace ledgerline::status
