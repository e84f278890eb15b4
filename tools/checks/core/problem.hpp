#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"

/// What can be wrong on a host and before a flight, with its cure: the one text for the lines of `ledgerline doctor`,
/// of `ledgerline tello preflight` and of `ledgerline fly`, and for docs/troubleshooting.md. Pure; any thread.
namespace ledgerline::checks {

/// Each with its severity, its cause and its cure; in the order of docs/troubleshooting.md.
#define LEDGERLINE_PROBLEMS(X)                                                                                        \
  /* files */                                                                                                         \
  X(config_missing, broken, "a role of this host has no config",                                                      \
    "`ledgerline init --role ROLE` writes it; or name the folder with --config-dir")                                  \
  X(config_wrong, broken, "a config is no TOML, has an unknown key, or a value out of range",                         \
    "change what the line says; docs/configuration.md has every key")                                                 \
  X(file_forbidden, broken, "this user may not read a file that the programs need",                                   \
    "as root: `chown -R USER: FOLDER` for keys, `chmod a+r FILE` for others; or be the programs' user")               \
  X(not_pem, broken, "a certificate is binary (DER): programs read PEM",                                              \
    "`openssl x509 -inform der -in FILE -out FILE.pem && cp FILE.pem FILE`")                                          \
  X(drones_differ, broken, "link.toml and agent.toml name different drones",                                          \
    "give each [[drone]] the same name in both, the enrolled one")                                                    \
  X(state_folder, broken, "a program's folder for its state is missing, or not writable",                             \
    "make it for the programs' user: `install -d -o ledgerline FOLDER`")                                              \
  X(disk_read_only, broken, "the file system that programs write to is read-only",                                    \
    "`mount -o remount,rw MOUNT`; where `dmesg` has errors of it, replace the card or disk")                          \
  X(disk_full, broken, "less than 64 MB are free where programs write: a node takes commands and stops alone",        \
    "delete old traces and logs, or let [output], or the node's --dir, lead to another disk")                         \
  X(disk_low, warning, "less than 1 GB is free where programs write: a trace takes 0.3 GB an hour",                   \
    "delete old traces and logs")                                                                                     \
  /* the identity */                                                                                                  \
  X(certificate_missing, broken, "msp_dir has no readable signcerts/*.pem",                                           \
    "let the authority sign the request, then `ledgerline init --certificate FILE`")                                  \
  X(certificate_wrong, broken, "signcerts/ has no certificate of P-256 or P-384",                                     \
    "let the authority sign the request again, then `ledgerline init --certificate FILE`")                            \
  X(certificate_order, broken, "the certificate's file begins with its authority's",                                  \
    "`ledgerline init --certificate FILE`, with the file itself, puts the own one first")                             \
  X(key_missing, broken, "msp_dir has no keystore/*_sk that this user can read",                                      \
    "be the programs' user; else `ledgerline init --request NAME` makes a key")                                       \
  X(key_open, broken, "others than its owner may read the key: no program takes it",                                  \
    "`chmod 600` it; if outsiders have accounts here, make a new one and revoke the certificate")                     \
  X(key_locked, broken, "a pass phrase locks the key, and nobody is there to type it",                                \
    "`openssl pkey -in KEY -out KEY.open && cp KEY.open KEY && rm KEY.open`")                                         \
  X(key_misfit, broken, "key and certificate do not belong together",                                                 \
    "`ledgerline init --certificate FILE` with the certificate of this key's request")                                \
  X(identity_expired, broken, "the identity's certificate has expired",                                               \
    "let the authority sign the request again, then `ledgerline init --certificate FILE`")                            \
  X(identity_not_yet, broken, "the identity's certificate is not valid yet, by this host's clock",                    \
    "set the clock (`chronyc tracking`, `timedatectl`); else the authority's was ahead")                              \
  X(identity_ends, warning, "the identity's certificate ends within 30 days",                                         \
    "`ledgerline identity renew`, or a new signature and `ledgerline init --certificate FILE`, without a restart")    \
  X(identity_foreign, broken, "the identity is not of the organisation that msp_id names, or is revoked",             \
    "set msp_id to the identity's organisation, or let the organisation's authority, as the channel has it, sign a "  \
    "request")                                                                                                        \
  /* whom to trust */                                                                                                 \
  X(anchor_missing, warning, "no config_block is set: nobody checks who signed the peer's blocks",                    \
    "copy CHANNEL.block from the ledger's host and set [ledger] config_block")                                        \
  X(anchor_wrong, broken, "config_block is unreadable, or not of this channel",                                       \
    "copy CHANNEL.block from the ledger's host again (`ledgerline init --collect`)")                                  \
  X(authority_unreadable, broken, "the file of an [[msp]]'s authority cannot be read",                                \
    "copy the organisation's authority there (`ledgerline init --collect`)")                                          \
  X(authority_foreign, broken,                                                                                        \
    "an [[msp]] has another authority than the channel: that organisation is not trusted here",                       \
    "copy its authority from the ledger's host")                                                                      \
  X(organisation_missing, warning, "an organisation of the channel has no [[msp]]: it is not trusted here",           \
    "add an [[msp]] with its id and authority")                                                                       \
  /* the way to the ledger */                                                                                         \
  X(endpoint_wrong, broken, "an endpoint is not HOST:PORT", "write host and port alone: no https://, no path")        \
  X(name_unknown, broken, "the endpoint's host name has no address",                                                  \
    "spell it right; `getent hosts NAME` must answer, by DNS or /etc/hosts")                                          \
  X(no_route, broken, "this host has no way to the address",                                                          \
    "`ip route get ADDRESS` shows an interface that is down, or a wrong route")                                       \
  X(unreachable, broken, "nothing answers at the address in time",                                                    \
    "is that host on, and does its firewall let the port through?")                                                   \
  X(port_closed, broken, "the host answers, but nobody listens at the port",                                          \
    "start the ledger there, or set the endpoint to the port that it prints; `ss -ltn` there: at 127.0.0.1 only its " \
    "own host reaches it")                                                                                            \
  X(server_mute, broken, "the port takes connections, and no TLS comes back",                                         \
    "its process there (`ss -ltnp`): stopped? `kill -CONT`; hangs? restart it. Else long packets are lost: of "       \
    "`ping -M do -s 1400 HOST` only short ones pass? `ip link set dev INTERFACE mtu` to what passes")                 \
  X(no_tls, broken, "the listener at the port does not speak TLS with HTTP/2",                                        \
    "set the endpoint to the peer's or orderer's own port, not its chaincode or operations port")                     \
  X(tls_ca_unreadable, broken, "the file tls_ca is unreadable, or has no certificate",                                \
    "copy the TLS authority's certificate there (`ledgerline init --collect`)")                                       \
  X(tls_wrong_authority, broken, "the server's TLS certificate is not of the authority in tls_ca",                    \
    "the endpoint must be no chaincode's port, and tls_ca the TLS authority of its organisation, not the "            \
    "identities' one")                                                                                                \
  X(tls_wrong_name, broken, "the server's TLS certificate does not have the name that it is asked by",                \
    "set server_name, or the endpoint, to a name in the certificate")                                                 \
  X(tls_expired, broken, "the server's TLS certificate, or its authority's, has expired",                             \
    "renew it and restart the server; if it is in date, set this host's clock")                                       \
  X(tls_not_yet, broken, "the server's TLS certificate is not valid yet, by this host's clock",                       \
    "set the clock of this host, or of the authority's")                                                              \
  X(tls_client_certificate, broken, "the server wants a TLS certificate from its clients",                            \
    "give the program one (tls_certificate and tls_key); or let the server go without: peer.tls.clientAuthRequired: " \
    "false, ledgerline-node without --tls-client-ca")                                                                 \
  X(tls_pair_wrong, broken, "tls_certificate and tls_key are missing, no pair, or out of date",                       \
    "let an authority that the server knows sign a certificate of this key, as tls_certificate")                      \
  X(tls_pair_refused, broken,                                                                                         \
    "the server refuses the program's TLS certificate: out of date, or of an unknown authority",                      \
    "let an authority of the server's clients sign it (peer.tls.clientRootCAs, ledgerline-node's --tls-client-ca), "  \
    "or add its authority there")                                                                                     \
  /* the ledger */                                                                                                    \
  X(ledger_refuses, broken, "the peer answers, and refuses what it is asked",                                         \
    "its words say why: another channel's name, an unknown identity")                                                 \
  X(peer_lags, warning, "the peer has fewer blocks than another organisation's",                                      \
    "look at its log, its disk and its way to the orderers")                                                          \
  X(checkpoint_refused, broken,                                                                                       \
    "the file of [output] checkpoint is damaged, or the peer's chain is not the one it is of",                        \
    "compare with another organisation's peer; where a copy was put back on purpose, remove the file")                \
  X(contract_silent, broken, "the peer does not reach the contract's service",                                        \
    "start `ledgerline-chaincode` where the package's `--address` leads (docs/own-fabric.md)")                        \
  X(contract_missing, broken, "the channel has no contract of that name",                                             \
    "administrators: `ledgerline contract` (docs/own-fabric.md); or set [ledger] contract to its name")               \
  X(contract_other_version, warning, "the committed contract is not of these programs' version",                      \
    "administrators: `ledgerline contract` (docs/own-fabric.md); the agent's log says what it refuses")               \
  X(policy_weak, warning,                                                                                             \
    "one organisation alone satisfies the contract's endorsement policy: it can make any record",                     \
    "define the contract with a majority (docs/ledger.md)")                                                           \
  X(policy_unreachable, broken, "the peers that sign for this program do not suffice: its calls would be refused",    \
    "start the peer of the organisation that the line names, or name it in an [[endorser]]; else change the "         \
    "contract's policy (docs/own-fabric.md)")                                                                         \
  X(blocks_late, broken, "the channel cuts blocks so late that commands are too old",                                 \
    "set `timeouts = \"auto\"` in [ledger], or the times that the line names, or a shorter BatchTimeout")             \
  X(records_unread, broken, "the drones' records cannot be read from the ledger",                                     \
    "is its peer up, and [ledger] endpoint, tls_ca and msp_dir in the file of ledger.ground right?")                  \
  /* the drones on it */                                                                                              \
  X(not_enrolled, broken, "the ledger has no record of the drone",                                                    \
    "its organisation's administrator: `ledgerline control --config admin.toml enroll --msp MSPID --cert FILE NAME`") \
  X(of_another_host, broken, "the drone is enrolled to another identity than this host's agent has",                  \
    "enroll it to this one, or fly it from that host; a renewed certificate must keep its subject")                   \
  X(may_not_fly, broken, "this identity is no operator, or has no grant: it cannot acquire the drone",                \
    "administrators: `ledgerline control enroll --role operator` in one's own organisation, `grant --fly` in the "    \
    "drone's")                                                                                                        \
  X(lease_held, warning, "somebody else holds the drone's lease",                                                     \
    "`ledgerline control request NAME`, and the holder hands it over; or `acquire` with a higher priority; if the "   \
    "holder is gone, a supervisor of the drone's organisation: `ledgerline control evict NAME`")                      \
  X(stopped, warning, "the drone is stopped: it does not take off",                                                   \
    "its stopper, or a supervisor of its organisation: `ledgerline control clear_stop NAME`")                         \
  /* clocks */                                                                                                        \
  X(clock_unsynchronised, warning, "the kernel says that this host's clock is not synchronised",                      \
    "run chrony or another NTP client on every host")                                                                 \
  X(clock_behind, broken, "the newest block was signed in this host's future: its clock is behind",                   \
    "set both hosts' clocks by NTP (`chronyc tracking` shows the offset)")                                            \
  X(clock_ahead, warning, "blocks are long ago by this host's clock: it is ahead, or the signer's behind",            \
    "set both hosts' clocks by NTP (`chronyc tracking` shows the offset)")                                            \
  X(clock_of_poses, broken, "agent drops poses whose stamps are so far from this host's clock",                       \
    "set both computers' clocks by NTP (`chronyc tracking` shows the offset), or [pose] clock = \"arrival\"")         \
  /* the drones' host */                                                                                              \
  X(no_real_time, warning, "SCHED_FIFO is not permitted here: setpoints come late on a busy host",                    \
    "start link by its systemd unit, or `setcap cap_sys_nice,cap_ipc_lock+ep` on ledgerline-link")                    \
  X(no_locked_memory, warning, "memory may not be locked: a swapped page holds link up",                              \
    "start link by its systemd unit, or raise `ulimit -l`")                                                           \
  X(shm_small, broken, "/dev/shm has no room for RouDi: it needs 96 MB",                                              \
    "`mount -o remount,size=256m /dev/shm`; a container: --shm-size=256m")                                            \
  X(shm_not_writable, broken, "this user may not write to /dev/shm, where RouDi makes its memory",                    \
    "as root: `chmod 1777 /dev/shm`, or `mount -o remount,rw /dev/shm`")                                              \
  X(roudi_group, broken, "the group of RouDi's user must be plain, and both in /etc/passwd and /etc/group",           \
    "do as the line says; or start RouDi, link and agent with a plain group of the user: `sg GROUP -c PROGRAM`")      \
  X(roudi_group_shared, warning,                                                                                      \
    "other users are in the group of RouDi's user: they may write to the memory that drones are flown by",            \
    "run RouDi, link and agent as a user with its own group: `useradd --system --user-group ledgerline`")             \
  X(not_running, warning, "a config's program does not run",                                                          \
    "`systemctl start ledgerline-PROGRAM`; `journalctl -u ledgerline-PROGRAM` says why it ended")                     \
  X(roudi_silent, warning, "no RouDi runs: link and agent need it",                                                   \
    "`systemctl start ledgerline-roudi`, or start ledgerline-roudi by hand")                                          \
  X(roudi_left, broken, "a RouDi that is gone has left its socket",                                                   \
    "start ledgerline-roudi, which clears what its own user left; of another user: remove it as root")                \
  X(roudi_replaced, broken, "a program runs with a RouDi that is gone: nobody can join it",                           \
    "land, then `systemctl restart ledgerline-link ledgerline-agent`")                                                \
  X(roudi_foreign, broken, "a RouDi runs that has no pools for link and agent",                                       \
    "end it, or run its programs elsewhere; then start ledgerline-roudi")                                             \
  X(roudi_runs, broken, "a RouDi runs: a flight starts its own", "end it: `pgrep -af roudi` shows it")                \
  X(state_port_taken, broken, "another program has the UDP port of the drones' state texts",                          \
    "end it: `ss -ulpn` shows it; then start link")                                                                   \
  X(port_unusable, broken, "a simulated drone cannot have its UDP port",                                              \
    "end the program that has it: `ss -ulpn` shows it; or `ip link set lo up`")                                       \
  X(interface_missing, broken, "a config names a network interface that is not here",                                 \
    "plug it in, or correct its name: `ip -br link` lists them")                                                      \
  X(interface_down, broken, "a network interface of a config is down, or has no address",                             \
    "`ip link set NAME up`, and join its Wi-Fi")                                                                      \
  X(wrong_interface, broken, "the way to the drone leads over another interface than its config names",               \
    "join the drone's Wi-Fi with that interface: it needs an address of the drone's network")                         \
  X(drones_in_use, warning, "link runs: the drones were not asked, since they may fly",                               \
    "stop link first, with the drones on the ground")                                                                 \
  X(drone_silent, broken, "the drone does not answer",                                                                \
    "switch it on, and join its Wi-Fi: `ledgerline tello find --address ADDRESS`")                                    \
  X(drone_other, broken, "another drone than the file's answers at the address",                                      \
    "`ledgerline tello find` shows where each is: give it that address in the file")                                  \
  X(state_silent, broken, "the drone answers commands, but a firewall drops its state texts",                         \
    "let the port through: `iptables -I INPUT -p udp --dport 8890 -j ACCEPT`, `ufw allow 8890/udp` or `firewall-cmd " \
    "--add-port=8890/udp`; end every other program that speaks to the drone")                                         \
  X(state_unreadable, broken, "the drone's state texts are not understood",                                           \
    "a Tello's has `bat:87;h:0;tof:10;`: is it a Tello? Then give it DJI's newest firmware")                          \
  X(state_rare, warning, "fewer state texts than a Tello's ten a second arrive",                                      \
    "go nearer, or to a free Wi-Fi channel")                                                                          \
  X(battery_low, broken, "link takes off only above battery_low", "charge or change the battery")                     \
  X(battery_short, warning, "the battery is enough to take off, not for long", "charge or change the battery")        \
  X(battery_unknown, warning, "the drone does not report its battery", "ask it: `ledgerline tello info ADDRESS`")     \
  X(drone_hot, warning, "on the ground nothing cools the drone: it may switch itself off",                            \
    "take off soon, or switch it off and let it cool")                                                                \
  X(pose_silent, broken, "no pose of motion capture comes for a drone that flies by it",                              \
    "start motion capture; its topic ([mocap] of agent.toml, [pose] of a deployment) and type must be as "            \
    "`ros2 topic list -t` shows, and [dds] interfaces must reach it; agent.log says which it refuses; or fly by "     \
    "onboard odometry: [pose] source of "                                                                             \
    "link.toml")                                                                                                      \
  X(pose_refused, broken, "agent takes no pose with these numbers",                                                   \
    "let motion capture be silent while it does not see the drone, and use three markers or more: one has no "        \
    "orientation")                                                                                                    \
  X(pose_old, broken, "the newest pose is older than link takes any",                                                 \
    "look whether motion capture sees the drone: markers, cameras, its own clock")                                    \
  X(pose_rare, warning, "poses of motion capture come rarely", "let motion capture publish more often, 100 a second") \
  X(pose_of_odometry, broken, "the newest position is of onboard odometry, not of motion capture",                    \
    "look whether motion capture sees the drone: markers, cameras, its own clock")                                    \
  X(velocity_missing, broken, "a drone that flies by onboard odometry reports no velocity",                           \
    "light, and a floor with texture; a firmware whose state text has vgx, vgy, vgz")                                 \
  X(velocity_no_reserve, warning, "the drone reports no velocity: nothing stands in for motion capture",              \
    "light, and a floor with texture; a firmware whose state text has vgx, vgy, vgz")                                 \
  X(position_uncertain, broken, "onboard odometry is too uncertain for the fence",                                    \
    "put the drone on its mark and switch it off and on")                                                             \
  X(odometry_short, warning, "onboard odometry may not last the path",                                                \
    "a wider [fence], a shorter path, mission pads or motion capture")                                                \
  X(not_on_ground, broken, "the drone is not on the ground", "land it: `ledgerline tello land ADDRESS`")              \
  X(takeoff_refused, broken, "link refuses a take-off", "docs/failsafe.md says what this cause clears by")            \
  /* of all drones of a flight */                                                                                     \
  X(frames_differ, broken, "poses of two drones are in different frames",                                             \
    "let one motion capture publish all of them in one frame")                                                        \
  X(outside_fence, broken, "a drone stands outside the fence",                                                        \
    "put it inside, or give [fence] and motion capture the same origin and axes")                                     \
  X(path_beyond_fence, broken, "the flight's path leaves the fence",                                                  \
    "a smaller side, another start, or [fence] as the room is")

enum class Problem : std::uint8_t {
#define LEDGERLINE_PROBLEM(name, severity, cause, cure) name,
  LEDGERLINE_PROBLEMS(LEDGERLINE_PROBLEM)
#undef LEDGERLINE_PROBLEM
};

enum class Severity : std::uint8_t { ok, warning, broken };
inline constexpr std::array severities{"ok", "warning", "broken"};
static_assert(severities.size() == enum_count<Severity>);

struct Description {
  const char* name;
  Severity severity;
  const char* cause;
  const char* cure;
};

/// In the order of the enum.
inline constexpr std::size_t problem_count = enum_count<Problem>;
const std::array<Description, problem_count>& all_problems();
inline const Description& describe(Problem problem) { return all_problems()[static_cast<std::size_t>(problem)]; }
/// The problem's own cure, with a value in each place of `placeholder`: "FILE", "NAME".
std::string cure_of(Problem problem, std::string_view placeholder, std::string_view value);

/// What one check has found: a line of the list.
struct Finding {
  std::string check;    ///< "identity"
  std::string drone{};  ///< whose it is; empty: of the host, or of all drones
  std::string what;     ///< of which file or place, and what was found
  std::optional<Problem> problem{};
  Severity severity = Severity::ok;  ///< the problem's own, unless who asks has another use for it
  std::string cure{};                ///< more exact than the problem's own; empty: that
};
using Findings = std::vector<Finding>;

Finding fine(std::string check, std::string what);
Finding flag(Problem problem, std::string check, std::string what, std::string cure = {});
/// As before a take-off, which must wait for it.
Finding as_broken(Finding finding);
/// As of this drone.
Finding of_drone(std::string drone, Finding finding);
void add(Findings& all, Findings more);

/// Each in its first place: several programs of a host have the same problem, or name the same file.
Findings without_repeats(Findings findings);

/// Whether something is broken; warnings are not.
bool anything_broken(const Findings& findings);
/// A line each, a cure below what is not ok, and how many there were.
std::string words(const Findings& findings);
/// An error: what is broken, with its cures, as part of a sentence.
Status check(const Findings& findings);
/// {"ok":true,"checks":[{"check":"identity","drone":"tello1"|null,"verdict":"broken","problem":"key_open"|null,
/// "what":"...","cure":"..."|null}]}
std::string to_json(const Findings& findings);

/// What docs/troubleshooting.md has of these problems: a Markdown table.
std::string problems_table();

}  // namespace ledgerline::checks
