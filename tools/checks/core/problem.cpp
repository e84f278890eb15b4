#include "tools/checks/core/problem.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/text.hpp"

namespace ledgerline::checks {
namespace {

using enum Problem;
using enum Severity;

constexpr const char* wifi_cure = "go nearer, or to a Wi-Fi channel that nobody else has";
constexpr const char* mocap_cure = "look whether motion capture sees the drone: markers, cameras, its own clock";
constexpr const char* velocity_cure =
    "light, and a floor with something to be seen on it; a firmware whose state text has vgx, vgy, vgz";

constexpr std::array<Description, problem_count> table{{
    {config_missing, "config_missing", broken, "the host has no config of a role that it is to have",
     "`ledgerline init --role ROLE` writes it; or name the folder with --config-dir"},
    {config_wrong, "config_wrong", broken, "a config is no TOML, has an unknown key, or a value out of its range",
     "change what the line says; docs/configuration.md has every key"},
    {file_forbidden, "file_forbidden", broken, "this user may not read a file that the programs need",
     "as root: `chown -R USER: FOLDER` for keys, `chmod a+r FILE` for the others; or run doctor as the programs' user"},
    {not_pem, "not_pem", broken, "a certificate lies there in binary form (DER): programs read PEM",
     "`openssl x509 -inform der -in FILE -out FILE.pem && cp FILE.pem FILE`"},
    {drones_differ, "drones_differ", broken, "link.toml and agent.toml name other drones: nobody speaks for some",
     "give each [[drone]] the same name in both, the one that it is enrolled by"},
    {state_folder, "state_folder", broken,
     "a folder where a program keeps what it remembers is missing, or may not be written",
     "make it, and give it to the user who runs the programs: `install -d -o ledgerline FOLDER`"},
    {disk_read_only, "disk_read_only", broken, "the file system that programs write to is mounted read-only",
     "`mount -o remount,rw MOUNT`; `dmesg` says whether the kernel did it after errors: then replace the card or disk"},
    {disk_full, "disk_full", broken, "less than 64 MB are free where programs write",
     "delete old traces and logs, or let [output] lead to another disk"},
    {disk_low, "disk_low", warning, "less than 1 GB is free where programs write: a trace takes 0.3 GB an hour",
     "delete old traces and logs before a long flight"},

    {certificate_missing, "certificate_missing", broken, "msp_dir has no signcerts/*.pem that can be read",
     "let the authority sign the request, then `ledgerline init --certificate FILE`"},
    {certificate_wrong, "certificate_wrong", broken, "what lies in signcerts/ is no certificate of P-256 or P-384",
     "let the authority sign the request again, then `ledgerline init --certificate FILE`"},
    {certificate_order, "certificate_order", broken,
     "the certificate's file has another one, its authority's, in front of the own: the first one counts",
     "`ledgerline init --certificate FILE`, with the file itself, puts the own one first"},
    {key_missing, "key_missing", broken, "msp_dir has no keystore/*_sk that this user can read",
     "run doctor as the user of the programs; else `ledgerline init --request NAME` makes a key"},
    {key_open, "key_open", broken, "others than its owner may read the key: no program takes it",
     "`chmod 600` it; if outsiders have accounts here, make a new one and revoke the certificate"},
    {key_locked, "key_locked", broken, "a pass phrase locks the key: a program that starts by itself has nobody to ask",
     "`openssl pkey -in KEY -out KEY.open && cp KEY.open KEY && rm KEY.open`"},
    {key_misfit, "key_misfit", broken, "key and certificate do not belong together",
     "put the certificate there that was made of this key's request: `ledgerline init --certificate FILE`"},
    {identity_expired, "identity_expired", broken, "the identity's certificate has expired",
     "let the authority sign the request again, then `ledgerline init --certificate FILE`, and start the program "
     "again"},
    {identity_not_yet, "identity_not_yet", broken, "the identity's certificate is not valid yet, by this host's clock",
     "set the clock (`chronyc tracking`, `timedatectl`); else the authority's was ahead"},
    {identity_ends, "identity_ends", warning, "the identity's certificate ends within 30 days",
     "`ledgerline identity renew`, or let the authority sign the request again and `ledgerline init --certificate "
     "FILE`: "
     "programs that run take it"},
    {identity_foreign, "identity_foreign", broken,
     "the organisation that msp_id names has not issued the identity, or has revoked it: the ledger refuses it",
     "set msp_id to the organisation of the identity, or let the organisation's authority, as the channel has it, "
     "sign a request"},

    {anchor_missing, "anchor_missing", warning,
     "no config_block is set: the peer's blocks are taken without checking who signed them",
     "copy CHANNEL.block from the ledger's host and set [ledger] config_block"},
    {anchor_wrong, "anchor_wrong", broken, "config_block cannot be read, or is not a configuration of this channel",
     "copy CHANNEL.block from the ledger's host again (`ledgerline init --collect`)"},
    {authority_unreadable, "authority_unreadable", broken, "the file of an [[msp]]'s authority cannot be read",
     "copy the organisation's authority to the path that the config names (`ledgerline init --collect`)"},
    {authority_foreign, "authority_foreign", broken,
     "an [[msp]] has another authority than the channel: what that organisation signs is not trusted here",
     "copy the authority's certificate of that organisation from the ledger's host"},
    {organisation_missing, "organisation_missing", warning,
     "an organisation of the channel has no [[msp]]: whatever it signs is not trusted here",
     "add an [[msp]] with its id and authority"},

    {endpoint_wrong, "endpoint_wrong", broken, "an endpoint is not HOST:PORT",
     "write the host and the port, and nothing else: no https://, no path"},
    {name_unknown, "name_unknown", broken, "the endpoint's host name has no address",
     "spell it right; `getent hosts NAME` must answer: DNS, or a line in /etc/hosts"},
    {no_route, "no_route", broken, "this host has no way to the address",
     "`ip route get ADDRESS` says why: an interface that is down, a missing route, another default route"},
    {unreachable, "unreachable", broken, "nothing answers at the address: no word came in time",
     "is that host on, and does its firewall let the port through?"},
    {port_closed, "port_closed", broken, "the host answers, but nobody listens at the port",
     "start the ledger there, or set the endpoint to the port that it prints; `ss -ltn` there: at 127.0.0.1 only "
     "its own host reaches it"},
    {server_mute, "server_mute", broken, "the port takes connections, and no TLS comes back: long packets may be lost",
     "`ping -M do -s 1400 HOST`: where long ones fail and short ones pass, `ip link set dev INTERFACE mtu` to what "
     "passes; else it is no server of TLS, or it hangs"},
    {no_tls, "no_tls", broken, "the listener at the port does not speak TLS with HTTP/2",
     "set the endpoint to the peer's or orderer's own port, not to its chaincode or operations port"},
    {tls_ca_unreadable, "tls_ca_unreadable", broken, "the file tls_ca cannot be read, or has no certificate",
     "copy the TLS authority's certificate to that path (`ledgerline init --collect`)"},
    {tls_wrong_authority, "tls_wrong_authority", broken,
     "the server's TLS certificate is not of the authority in tls_ca",
     "set tls_ca to the TLS authority of the server's organisation, which is not the identities' authority"},
    {tls_wrong_name, "tls_wrong_name", broken,
     "the server's TLS certificate does not have the name that it is asked by",
     "set server_name to a name that the certificate has, or the endpoint to such a name"},
    {tls_expired, "tls_expired", broken, "the server's TLS certificate, or its authority's, has expired",
     "renew it on the server's host and start the server again; if it is in date, set this host's clock"},
    {tls_not_yet, "tls_not_yet", broken, "the server's TLS certificate is not valid yet, by this host's clock",
     "set the clock of this host, or of the authority's"},
    {tls_client_certificate, "tls_client_certificate", broken, "the server wants a TLS certificate from its clients",
     "give the program one (tls_certificate and tls_key); or let the server go without: a peer by "
     "peer.tls.clientAuthRequired: false, ledgerline-node without --tls-client-ca"},
    {tls_pair_wrong, "tls_pair_wrong", broken,
     "tls_certificate and tls_key are not what the program can show: not there, no pair, or out of date",
     "let an authority that the server knows sign a certificate of this key, and put it into tls_certificate"},
    {tls_pair_refused, "tls_pair_refused", broken,
     "the server does not take the TLS certificate that the program shows: out of date, or of an authority that it "
     "does "
     "not know",
     "let an authority of the server's clients sign it again (a peer's peer.tls.clientRootCAs, ledgerline-node's "
     "--tls-client-ca), or add its authority there"},

    {ledger_refuses, "ledger_refuses", broken, "the peer answers, and refuses what it is asked",
     "its words say why: another channel's name, an identity that it does not know"},
    {peer_lags, "peer_lags", warning, "the peer has fewer blocks than another organisation's",
     "look at its log, its disk and its way to the orderers"},
    {contract_missing, "contract_missing", broken, "the channel has no contract of that name",
     "commit its definition on the channel (docs/fabric.md), or set [ledger] contract to its name there"},
    {contract_other_version, "contract_other_version", warning,
     "the contract that is committed has another version than these programs are made for",
     "bring contract and programs to one version (docs/fabric.md); the agent's log says what it refuses"},
    {policy_weak, "policy_weak", warning,
     "one organisation alone satisfies the contract's endorsement policy: it can make any record",
     "define the contract with a majority (docs/ledger.md)"},
    {policy_unreachable, "policy_unreachable", broken,
     "the peers that sign for this program are not those whose signatures its calls need: they would all be refused",
     "start the peer of the organisation that the line names, or name it in an [[endorser]]; else define the contract "
     "with a policy that the channel's peers can satisfy (docs/fabric.md)"},
    {blocks_late, "blocks_late", broken, "the channel cuts its blocks so late that commands are too old when they come",
     "set `timeouts = \"auto\"` in [ledger], or the times that the line names, or a shorter BatchTimeout"},
    {records_unread, "records_unread", broken, "the drones' records cannot be read from the ledger",
     "is its peer up, and endpoint, tls_ca and msp_dir of [ledger] in the file of ledger.ground right?"},

    {not_enrolled, "not_enrolled", broken, "the ledger has no record of the drone",
     "its organisation's administrator: `ledgerline control --config admin.toml enroll --msp MSPID --cert FILE NAME`"},
    {of_another_host, "of_another_host", broken, "the drone is enrolled to another identity than this host's agent has",
     "enroll it to this identity, or fly it from that host; names count, so a renewed certificate keeps its subject"},
    {may_not_fly, "may_not_fly", broken,
     "this identity is no operator, or has no grant of the drone's organisation: it cannot acquire the drone",
     "administrators: `ledgerline control enroll --role operator` in one's own organisation, `grant --fly` in the "
     "drone's"},
    {lease_held, "lease_held", warning, "somebody else holds the drone's lease: ground cannot command it",
     "`ledgerline control request NAME`, and the holder hands it over; or `acquire` with a higher priority; of "
     "one who is gone: a supervisor of the drone's organisation ends it by `ledgerline control evict NAME`"},
    {stopped, "stopped", warning, "the drone is stopped: it does not take off",
     "its stopper clears it: `ledgerline control clear_stop NAME`; or a supervisor of its organisation"},

    {clock_unsynchronised, "clock_unsynchronised", warning,
     "the kernel says that this host's clock is not synchronised",
     "run chrony or another client of NTP here and on every other host"},
    {clock_behind, "clock_behind", broken, "the newest block was signed in this host's future: its clock is behind",
     "set the clocks of both hosts by NTP (`chronyc tracking` shows the offset)"},
    {clock_ahead, "clock_ahead", warning,
     "blocks come, but each was signed long ago by this host's clock: it is ahead, or the signer's behind",
     "set the clocks of both hosts by NTP (`chronyc tracking` shows the offset)"},
    {clock_of_poses, "clock_of_poses", broken, "agent drops poses whose stamps are so far from this host's clock",
     "set the clocks of both computers by NTP (chrony: `chronyc tracking` shows the offset), or [pose] clock = "
     "\"arrival\""},

    {no_real_time, "no_real_time", warning, "SCHED_FIFO is not permitted here: setpoints come late on a busy host",
     "start link by its systemd unit, or `setcap cap_sys_nice,cap_ipc_lock+ep` on ledgerline-link"},
    {no_locked_memory, "no_locked_memory", warning,
     "memory may not be locked: a page that was swapped out holds link up",
     "start link by its systemd unit, or raise `ulimit -l`"},
    {shm_small, "shm_small", broken, "/dev/shm has no room for RouDi: it needs 96 MB",
     "`mount -o remount,size=256m /dev/shm`; a container: --shm-size=256m"},
    {roudi_silent, "roudi_silent", warning, "no RouDi runs: link and agent do not start without",
     "`systemctl start ledgerline-roudi`, or start ledgerline-roudi by hand"},
    {roudi_left, "roudi_left", broken, "a RouDi that is gone has left its socket, so nobody answers there",
     "start ledgerline-roudi, which clears what is left of its own user; of another user: remove it as root"},
    {roudi_foreign, "roudi_foreign", broken, "a RouDi that is not ours runs: it has no pools for link and agent",
     "end it, or run its programs elsewhere; then start ledgerline-roudi"},
    {roudi_runs, "roudi_runs", broken, "a RouDi, the broker of shared memory, runs: a flight starts its own",
     "end it: `pgrep -af roudi` shows it"},
    {state_port_taken, "state_port_taken", broken, "another program has the UDP port of the drones' state texts",
     "end it: `ss -ulpn` shows who has the port; then start link"},
    {port_unusable, "port_unusable", broken, "a simulated drone cannot have its UDP port",
     "end the program that has it: `ss -ulpn` shows who; or `ip link set lo up`"},
    {interface_missing, "interface_missing", broken, "a config names a network interface that this host does not have",
     "`ip -br link` shows those there are; plug it in, or correct its name"},
    {interface_down, "interface_down", broken, "a network interface that a config names is down, or has no address",
     "`ip link set NAME up`, and join its Wi-Fi"},
    {wrong_interface, "wrong_interface", broken,
     "the way to the drone leads over another interface than its config names",
     "join the drone's Wi-Fi with that interface: it needs an address of the drone's network"},
    {drones_in_use, "drones_in_use", warning, "link runs: the drones were not asked, since they may fly",
     "stop link first, with the drones on the ground"},
    {drone_silent, "drone_silent", broken, "the drone does not answer",
     "switch it on, and join its Wi-Fi: `ledgerline tello find --address ADDRESS`"},
    {drone_other, "drone_other", broken, "another drone than the file's answers at the address",
     "look where each is with `ledgerline tello find`, and give it its address in the file"},
    {state_silent, "state_silent", broken,
     "the drone answers commands, and none of its state texts arrives: a firewall drops their UDP port",
     "let the port through at this host: `iptables -I INPUT -p udp --dport 8890 -j ACCEPT`, `ufw allow 8890/udp` or "
     "`firewall-cmd --add-port=8890/udp`, whichever firewall it has; end every other program that speaks to the drone"},
    {state_rare, "state_rare", warning, "fewer state texts arrive than the ten a second of a Tello", wifi_cure},
    {battery_low, "battery_low", broken, "link takes off only above battery_low", "charge or change the battery"},
    {battery_short, "battery_short", warning, "the battery is enough to take off, not for long",
     "charge or change the battery"},
    {battery_unknown, "battery_unknown", warning, "the drone does not report its battery",
     "ask it: `ledgerline tello info ADDRESS`"},
    {drone_hot, "drone_hot", warning, "on the ground nothing cools the drone, and it may switch itself off",
     "take off soon, or switch it off and let it cool"},
    {pose_silent, "pose_silent", broken, "no pose of motion capture comes for a drone that flies by it",
     "start motion capture; `ros2 topic list -t` shows what it publishes, which [mocap] topic and type of agent.toml "
     "must say, and [dds] interfaces must reach it; or set [pose] source of link.toml to onboard odometry"},
    {pose_old, "pose_old", broken, "the newest pose is older than link takes any", mocap_cure},
    {pose_rare, "pose_rare", warning, "poses of motion capture come rarely",
     "let motion capture publish more often, 100 a second"},
    {pose_of_odometry, "pose_of_odometry", broken, "the newest position is of onboard odometry, not of motion capture",
     mocap_cure},
    {velocity_missing, "velocity_missing", broken, "a drone that flies by onboard odometry reports no velocity",
     velocity_cure},
    {velocity_no_reserve, "velocity_no_reserve", warning,
     "the drone reports no velocity: nothing stands in for motion capture", velocity_cure},
    {position_uncertain, "position_uncertain", broken, "onboard odometry is too uncertain for the fence",
     "put the drone on its mark and switch it off and on"},
    {not_on_ground, "not_on_ground", broken, "the drone is not on the ground",
     "land it: `ledgerline tello land ADDRESS`"},
    {takeoff_refused, "takeoff_refused", broken, "link refuses a take-off",
     "docs/failsafe.md says what this cause clears by"},

    {frames_differ, "frames_differ", broken, "poses of two drones are in different frames",
     "let one motion capture publish all of them in one frame"},
    {outside_fence, "outside_fence", broken, "a drone stands outside the fence",
     "put it inside, or let [fence] and motion capture have the same origin and axes"},
    {path_beyond_fence, "path_beyond_fence", broken, "the flight's path leaves the fence",
     "a smaller side, another start, or [fence] as the room is"},
}};

constexpr bool in_order() {
  for (std::size_t i = 0; i < table.size(); ++i)
    if (static_cast<std::size_t>(table[i].problem) != i) return false;
  return true;
}
static_assert(in_order());

const char* name_of(Severity severity) { return severities[static_cast<std::size_t>(severity)]; }

std::string cure_of(const Finding& finding) {
  if (!finding.problem) return "";
  return printable(finding.cure.empty() ? describe(*finding.problem).cure : finding.cure);
}

std::string what_of(const Finding& finding) {
  return printable(finding.drone.empty() ? finding.what : finding.drone + ": " + finding.what);
}

long count(const Findings& findings, Severity severity) {
  return std::count_if(findings.begin(), findings.end(), [&](const Finding& f) { return f.severity == severity; });
}

nlohmann::json or_null(const std::string& text) { return text.empty() ? nlohmann::json() : nlohmann::json(text); }

}  // namespace

const std::array<Description, problem_count>& all_problems() { return table; }

std::string cure_of(Problem problem, std::string_view placeholder, std::string_view value) {
  std::string cure = describe(problem).cure;
  for (std::size_t at = 0; (at = cure.find(placeholder, at)) != std::string::npos; at += value.size())
    cure.replace(at, placeholder.size(), value);
  return cure;
}

Finding fine(std::string check, std::string what) { return {.check = std::move(check), .what = std::move(what)}; }

Finding found(Problem problem, std::string check, std::string what, std::string cure) {
  return {std::move(check), "", std::move(what), problem, describe(problem).severity, std::move(cure)};
}

Finding as_broken(Finding finding) {
  finding.severity = Severity::broken;
  return finding;
}

Finding of_drone(std::string drone, Finding finding) {
  finding.drone = std::move(drone);
  return finding;
}

void add(Findings& all, Findings more) {
  all.insert(all.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
}

bool anything_broken(const Findings& findings) { return count(findings, Severity::broken) > 0; }

std::string words(const Findings& findings) {
  std::string text;
  for (const Finding& finding : findings) {
    text += fmt::format("{:<8} {:<11} ", name_of(finding.severity), finding.check);
    if (finding.problem) {
      const Description& problem = describe(*finding.problem);
      text += fmt::format("{}: {} ({})\n{:21}cure: {}\n", problem.name, what_of(finding), problem.cause, "",
                          cure_of(finding));
    } else {
      text += what_of(finding) + "\n";
    }
  }
  return text + fmt::format("{} ok, {} to be warned of, {} broken\n", count(findings, Severity::ok),
                            count(findings, Severity::warning), count(findings, Severity::broken));
}

Status check(const Findings& findings) {
  std::string text;
  for (const Finding& finding : findings) {
    if (finding.severity != Severity::broken) continue;
    const std::string whose = finding.drone.empty() ? "" : finding.drone + "'s ";
    text += printable(fmt::format("{}{}{}: {}: {} (cure: {})", text.empty() ? "" : "; ", whose, finding.check,
                                  finding.what, describe(*finding.problem).cause, cure_of(finding)));
  }
  if (!text.empty()) return Error{text};
  return done;
}

std::string to_json(const Findings& findings) {
  nlohmann::json checks = nlohmann::json::array();
  for (const Finding& finding : findings) {
    checks.push_back({{"check", finding.check},
                      {"drone", or_null(printable(finding.drone))},
                      {"verdict", name_of(finding.severity)},
                      {"problem", or_null(finding.problem ? describe(*finding.problem).name : "")},
                      {"what", printable(finding.what)},
                      {"cure", or_null(cure_of(finding))}});
  }
  return nlohmann::json{{"ok", !anything_broken(findings)}, {"checks", checks}}.dump();
}

std::string problems_table() {
  std::string text = "| word | | cause | cure |\n| --- | --- | --- | --- |\n";
  for (const Description& one : all_problems())
    text += fmt::format("| `{}` | {} | {} | {} |\n", one.name, name_of(one.severity), one.cause, one.cure);
  return text;
}

}  // namespace ledgerline::checks
