#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"

/// What `ledgerline status` reports, and what /proc says of a process, read. Pure.
namespace ledgerline::status {

/// A program of ours that runs on this host.
struct Program {
  std::string name;  ///< "ledgerline-agent", "ledgerline hil"
  int pid = 0;
  std::string user{};     ///< its name, or its number where it has none
  std::string unit{};     ///< of systemd; empty: no unit started it
  std::string config{};   ///< absolute where it can be known; empty: it has none
  std::string dir{};      ///< likewise a node's
  TimeNs age_ns = 0;      ///< since it was started
  bool replaced = false;  ///< its file is not the one that was started: another version begins with its next start
  bool halted = false;    ///< it stands still, by SIGSTOP or a debugger
};

struct Peer {
  std::string endpoint, msp_id;  ///< msp_id: empty where the config does not say
  std::optional<std::uint64_t> height{};
  std::string why{};      ///< it has none: the peer's words, or why it is not reached
  bool endorser = false;  ///< it answers, as an organisation's own endorser, which keeps no blocks
};

struct Drone {
  std::string name;
  std::optional<TimeNs> state_age_ns{};  ///< of its newest state, by this host's clock; none: the ledger has none of it
  std::string phase{};                   ///< of its flight in that state: "on_ground"; empty: the ledger has none
  std::string owner{}, holder{}, delegate{};  ///< "MSP subject"; empty: nobody
  std::string stopped_by{};                   ///< the first who has stopped it; empty: nobody
  std::string why{};                          ///< nothing is known of it: the ledger's words
};

/// A service's config, "agent", that no program runs by.
struct NotRunning {
  std::string program, config;
};

/// A channel, as one config sees it.
struct Ledger {
  std::string config, channel;
  std::vector<Peer> peers{};  ///< the config's own first
  std::optional<TimeNs> newest_block_age_ns{};
  std::vector<Drone> drones{};
  std::string why{};  ///< nothing could be asked: what is wrong with the config
};

struct Status {
  std::vector<Program> programs;
  std::vector<NotRunning> not_running;
  std::vector<Ledger> ledgers;
};

/// 340 ms, 12.5 s, 4 min, 3 h, 2 d; a clock that is behind: "-20 ms".
std::string words_of_age(TimeNs age_ns);
/// Tables for people.
std::string words(const Status& status);
/// {"programs":[{"program","pid","user","unit"|null,"config"|null,"age_s","replaced","halted"}],
/// "not_running":[{"program","config"}],"ledgers":[{"config","channel","newest_block_age_s"|null,"why"|null,
/// "peers":[{"endpoint","msp_id"|null,"height"|null,"endorser","why"|null}],"drones":[{"drone","state_age_s"|null,
/// "phase"|null,"owner"|null,"holder"|null,"delegate"|null,"stopped_by"|null,"why"|null}]}]}
std::string to_json(const Status& status);
/// Whether every config's program runs and every ledger answered.
bool all_well(const Status& status);

/// Whether the config of a program, "agent", is one of a service: others have no process of their own.
bool is_service(const std::string& program);
/// Whether a service runs, and does not stand still, by the config at this absolute path. Where /proc hides the folder
/// that a program was started in, its file's name counts.
bool is_running(const std::vector<Program>& programs, const std::string& program, const std::string& config);

/// The command line's words: /proc/PID/cmdline, where a zero byte ends each.
std::vector<std::string> words_of(const std::string& cmdline);
/// What stands behind an option such as `--config`, or in `--config=...`; empty: neither is there.
std::string value_of(const std::string& option, const std::vector<std::string>& words);
/// "ledgerline-agent.service" of /proc/PID/cgroup; empty: no unit's.
std::string unit_of(const std::string& cgroup);
/// Of /proc/PID/status.
bool is_halted(const std::string& status);
/// When it was started, in s since boot, of /proc/PID/stat (proc(5), field 22); none: that is no such text.
std::optional<double> start_of(const std::string& stat, double ticks_per_s);
/// Of the text that /proc/PID/exe leads to: the program's file, and whether it is there no more.
struct Executable {
  std::string file;
  bool deleted = false;
};
Executable executable_of(const std::string& link);
/// A program's name as it is typed, by its file and its command line; empty: it is none of ours.
std::string name_of(const std::string& file, const std::vector<std::string>& words);

}  // namespace ledgerline::status
