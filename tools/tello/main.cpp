#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/dds/dds.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/checks/core/drone.hpp"
#include "tools/command/verbs.hpp"
#include "tools/launcher/options.hpp"
#include "tools/tello/core/calibrate/estimate.hpp"
#include "tools/tello/core/dialogue.hpp"
#include "tools/tello/shell/calibrate.hpp"
#include "tools/tello/shell/preflight.hpp"
#include "tools/tello/shell/talk.hpp"

namespace {

using namespace ledgerline;

constexpr const char* usual_address = "192.168.10.1";  // of every Tello in its own Wi-Fi

struct Options {
  std::string address = usual_address, interface, subnet, ssid, password_file;
  std::vector<std::string> addresses;
  std::string mocap = "none", config, out = "calibration.toml";
  std::string deployment, cyclonedds, shape;
  int repeat = 2;
  double seconds = 20, listen_s = 3;
  bool json = false, yes = false;
};

Result<std::vector<tello::Found>> asked_for(const std::vector<std::string>& addresses, const std::string& subnet) {
  std::vector<std::uint32_t> hosts;
  if (!subnet.empty()) {
    auto all = tello::hosts_of(subnet);
    if (!all) return all.error();
    hosts = std::move(*all);
  }
  for (const std::string& text : addresses) {
    const auto address = parse_ipv4(text);
    if (!address) return address.error();
    if (std::find(hosts.begin(), hosts.end(), *address) == hosts.end()) hosts.push_back(*address);
  }
  std::vector<tello::Found> drones;
  for (const std::uint32_t host : hosts) drones.push_back({host, tello::Dialogue(tello::questions_of_info())});
  return drones;
}

int show(const Options& options, std::vector<std::string> addresses) {
  if (addresses.empty() && options.subnet.empty()) addresses.emplace_back(usual_address);
  auto drones = asked_for(addresses, options.subnet);
  if (!drones) return fail(drones.error(), exit_usage);
  const std::size_t asked = drones->size();
  if (auto status = tello::query(*drones, options.interface); !status) return fail(status.error());
  std::erase_if(*drones, [](const tello::Found& drone) { return !drone.dialogue.present(); });
  if (options.json) print_line(tello::json(*drones));
  if (drones->empty()) {
    const std::string where = asked == 1 ? " at " + addresses.front() : fmt::format(" at any of {} addresses", asked);
    return fail(Error{"no Tello answers" + where + ": is it switched on, and this computer in its Wi-Fi?"});
  }
  if (!options.json) print_line(tello::words(*drones));
  return 0;
}

int join_wifi(const Options& options) {
  const auto password = tello::read_password(options.password_file);
  if (!password) return fail(password.error());
  if (const Status fits = tello::check_wifi(options.ssid, *password); !fits) return fail(fits.error(), exit_usage);
  const auto address = parse_ipv4(options.address);
  if (!address) return fail(address.error(), exit_usage);
  const std::string word = fmt::format("ap {} {}", options.ssid, *password);
  std::vector<tello::Found> drones{{*address, tello::Dialogue({word})}};
  if (auto status = tello::query(drones, options.interface); !status) return fail(status.error());
  const tello::Dialogue& dialogue = drones.front().dialogue;
  if (!dialogue.present()) return fail(Error{fmt::format("no Tello answers at {}", options.address)});
  const tello::Question& asked = dialogue.questions().back();
  if (asked.refused)
    return fail(Error{fmt::format("it refuses ({}): only a Tello EDU or TT can join a Wi-Fi", asked.answer)});
  if (asked.answer.empty())
    spdlog::warn("it was sent the command, and did not answer: it may have left its own Wi-Fi already");
  print_line(
      fmt::format("It restarts and joins {}. Its own Wi-Fi is gone then; join {} with this computer as well, "
                  "and look for it: ledgerline tello find --subnet ADDRESS/24. It joins so until its button was "
                  "held for 5 s, after which it has its own Wi-Fi again.",
                  options.ssid, options.ssid));
  return 0;
}

int land(const Options& options) {
  const auto address = parse_ipv4(options.address);
  if (!address) return fail(address.error(), exit_usage);
  const auto down = tello::land(*address, options.interface, options.seconds);
  if (down && *down) print_line(options.address + " is down");
  return exit_code(down);
}

int calibrate(const Options& options) {
  const auto address = parse_ipv4(options.address);
  if (!address) return fail(address.error(), exit_usage);
  auto dds = dds::participant_options_of(options.config, "ledgerline_tello");
  if (!dds) return fail(dds.error(), exit_usage);
  if (const Status room = check_folder_of(options.out); !room) return fail(room.error(), exit_usage);
  print_line(fmt::format(
      "{} will take off, and fly forwards and back, to its sides, up and down, and turn, for {} to {} s. It needs 4 m "
      "x "
      "4 m of free floor with something to be seen on it, light, 2.5 m of height, nobody near, and more than 30 % of "
      "battery. Ctrl-C lands it.",
      options.address, 15 + 62 * options.repeat, 15 + 90 * options.repeat));
  if (!options.yes && !tello::has_consent()) return fail(Error{"nobody said yes: its motors were not started"});
  const std::string topic = options.mocap == "none" ? "" : options.mocap;
  const auto record = tello::fly_calibration({*address, options.interface, topic, *dds, options.repeat});
  if (!record) return fail(record.error());
  const auto calibration = tello::estimate(*record);
  if (!calibration) return fail(Error{options.address + " is down, but: " + calibration.error().message});
  const std::string text = tello::toml(*calibration);
  if (auto status = replace_file(options.out, text); !status) return fail(status.error());
  print_line(text);
  if (!calibration->velocity)
    spdlog::warn("What vgx and vgy are worth was not measured, so link's wide defaults count: {}",
                 calibration->velocity.error().message);
  return 0;
}

// What the flight of this file would fly; fly's own reader says what is wrong with it.
Result<launcher::Options> flight_of(const Options& options) {
  std::vector<std::string> words{"--deployment", options.deployment};
  if (!options.cyclonedds.empty()) words.insert(words.end(), {"--dds", options.cyclonedds});
  if (!options.shape.empty()) words.insert(words.end(), {"--shape", options.shape});
  launcher::ParsedOptions asked = launcher::parse_command_line(words);
  if (!asked.fly) return Error{asked.text.substr(0, asked.text.find_last_not_of('\n') + 1)};
  if (!asked.options.own)
    return Error{options.deployment + ": names simulated drones; preflight is of drones that are there: docs/fly.md"};
  return asked.options;
}

int preflight(const Options& options) {
  auto flight = flight_of(options);
  if (!flight) return fail(flight.error(), exit_usage);
  const auto inputs = tello::probe_flight({std::move(*flight), programs_directory() / "ledgerline", options.listen_s});
  if (!inputs) return fail(inputs.error());
  const checks::Findings findings = assess(*inputs);
  if (options.json)
    print_line(to_json(findings));
  else
    std::fputs(("Before take-off:\n" + words(findings)).c_str(), stdout);
  return anything_broken(findings) ? exit_failed : 0;
}

constexpr const char* about =
    "Speaks to Tellos themselves, by the Tello SDK: who is there, what it is, how it joins a Wi-Fi; lands one,\n"
    "measures by a flight how one answers, and looks before a flight what is wrong.\n"
    "Not while ledgerline-link flies it (but for land): a Tello sends its state text to the client that spoke to it "
    "last.";
constexpr const char* notes = R"(Examples:
  ledgerline tello find                                   the Tello whose Wi-Fi this computer is in
  ledgerline tello find --interface wlan1                 the one behind another adapter
  ledgerline tello find --subnet 192.168.1.0/24 --json    all that joined this network
  ledgerline tello join-wifi lab --password-file wifi.txt
  ledgerline tello land 192.168.10.1
  ledgerline tello calibrate 192.168.10.1 --mocap /vrpn_mocap/tello1/pose
  ledgerline tello preflight --deployment real.toml       what would keep the flight of this file on the ground
Exit codes: 0 as asked (found, sent, down, written, nothing wrong), 1 not, 2 bad usage.)";

}  // namespace

int ledgerline::command::tello(int argc, char** argv) {
  CommandLine line("ledgerline tello", about, notes);
  Options options;
  const auto interface = [&](Verb& verb) {
    verb.option("--interface", options.interface, "network interface that it is behind, such as wlan1");
  };
  Verb find = line.verb("find", "say which Tellos answer: address, serial, battery, hardware, firmware");
  find.option("--address", options.addresses, "one to ask, 192.168.10.1 where none is named").one_at_a_time();
  find.option("--subnet", options.subnet, "ask each address of a subnet, /24 at most, such as 192.168.1.0/24");
  interface(find);
  find.flag("--json", options.json, "as JSON");
  Verb info = line.verb("info", "the same of one Tello");
  info.option("address", options.address, "its address").required();
  interface(info);
  info.flag("--json", options.json, "as JSON");
  Verb join = line.verb("join-wifi", "tell a Tello EDU or TT to join a Wi-Fi; the password is asked for, or in a file");
  join.option("ssid", options.ssid, "the Wi-Fi's name").required();
  join.option("--password-file", options.password_file, "file with the password in its first line").existing_file();
  join.option("--address", options.address, "the Tello's address").shows_default();
  interface(join);
  Verb landing =
      line.verb("land", "stop a Tello and land it, no matter who flew it: again each second until it is down");
  landing.option("address", options.address, "its address").required();
  landing.option("--seconds", options.seconds, "how long it is tried").within(1.0, 600.0).shows_default();
  interface(landing);
  Verb calibration =
      line.verb("calibrate", "fly a Tello for two to three minutes to measure how it answers rc, and what vg means");
  calibration.option("address", options.address, "its address").required();
  calibration.option("--mocap", options.mocap, "topic of its poses (PoseStamped on DDS), or none").shows_default();
  calibration.option("--config", options.config,
                     "TOML file: [dds] domain, local_only or cyclonedds, and the files of DDS Security (docs/ros2.md)");
  calibration.option("--out", options.out, "TOML file that is written").shows_default();
  calibration.option("--repeat", options.repeat, "times that the schedule of a minute is flown")
      .within(1, 5)
      .shows_default();
  calibration.flag("--yes", options.yes, "start the motors without asking");
  interface(calibration);
  Verb looking =
      line.verb("preflight",
                "say what would keep a flight on the ground, and its cure: drones, batteries, state and pose "
                "rates, leases, fence, clocks, ledger");
  looking.option("--deployment", options.deployment, "deployment.toml of drones that are there, as of `ledgerline fly`")
      .required()
      .existing_file();
  looking.option("--dds", options.cyclonedds, "file of Cyclone DDS's own configuration, for motion capture elsewhere")
      .existing_file();
  looking.option("--shape", options.shape, "as fly's, in place of the file's: its path is looked at");
  looking.option("--seconds", options.listen_s, "how long it listens to state text and poses")
      .within(1.0, 60.0)
      .shows_default();
  looking.flag("--json", options.json, "as JSON");
  if (const auto end = line.parse(argc, argv)) return *end;
  if (looking.is_given()) return preflight(options);
  if (calibration.is_given()) return calibrate(options);
  if (find.is_given()) return show(options, options.addresses);
  if (info.is_given()) return show(options, {options.address});
  return join.is_given() ? join_wifi(options) : land(options);
}
