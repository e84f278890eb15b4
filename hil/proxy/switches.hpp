#pragma once
#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/rt/clock.hpp"
#include "hil/netem/impairment.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"

namespace ledgerline::hil::proxy {

/// The directions of a drone and of a server, each impaired by itself.
enum class Direction { to, answers, state, video, from };
inline constexpr std::size_t ways = enum_count<Direction>;
std::string_view name_of(Direction way);

/// A drone (UDP: to, answers, state, video) or a server (TCP: to, from) behind the proxy.
struct Target {
  enum class Kind { drone, server };
  Kind kind = Kind::drone;
  std::string name;
  bool behind_shim = false;  ///< who stands between is the shim, which knows the SDK's calls, and has no video
  bool has(Direction way) const {
    if (way == Direction::video && behind_shim) return false;
    return way == Direction::to || (way == Direction::from) == (kind == Kind::server);
  }
};

/// What is switched at the moment, and how commands change it. A core; one thread. Commands:
///
///     drone tello1 to delay 200ms, loss 5%   EFFECTS of hil/netem/impairment.hpp on one way: to, answers, state,
///                                            video, from (the three before), both (all four)
///     drone * both clear                     `*`: every drone; for servers and sensors alike
///     server agent* both stall               `agent*`: each whose name begins so
///     server agent from stall                to, from, both
///     server agent cut                       its connections are reset, once
///     sensor tello1 h stuck                  one more fault of hil/netem/sdk/sdk_faults.hpp in that drone's state text
///     sensor tello1 h stuck off              one less
///     sdk tello1 answers late 300ms          one more fault of hil/netem/sdk/sdk_faults.hpp; `off` as with sensors
///     clear                                  no effect and no fault is left
///     list                                   changes nothing; what is switched is in list()
///
/// A command that is wrong anywhere, or that a target cannot have, changes nothing: its error says why. A recording, or
/// a recorded link, is read once, by the first command that names it.
class Switches {
 public:
  static constexpr std::size_t max_faults = 16;  ///< of a drone's sensors at once, and as many of its SDK

  /// Names are unique within a kind.
  explicit Switches(std::vector<Target> targets,
                    ReadRecording read = reading_once<Distribution::Recording>(read_recording),
                    ReadLinkRecording read_link_recording =
                        reading_once<std::shared_ptr<const LinkRecording>>(hil::read_link_recording));

  Status apply(std::string_view command);
  const std::vector<Target>& targets() const { return targets_; }
  const Impairment& of(std::size_t target, Direction way) const {
    return impairments_[target][static_cast<std::size_t>(way)];
  }
  /// What the target's state text says wrongly; each has an `item` of its own.
  std::vector<SensorFault> sensors(std::size_t target) const { return faults_in(sensors_[target]); }
  /// What goes wrong at the target's SDK, likewise.
  std::vector<SdkFault> sdk(std::size_t target) const { return faults_in(sdk_[target]); }
  /// Whether the target's connections are to be reset, since the last call.
  bool pop_cut(std::size_t target);
  /// One line of text a direction that is impaired, as a command would say it.
  std::string list() const;

 private:
  /// A fault as it was switched on, so that the same words switch it off.
  template <typename Fault>
  struct Switched {
    std::string text;
    Fault fault;
  };
  template <typename Fault>
  static std::vector<Fault> faults_in(const std::vector<Switched<Fault>>& switched) {
    std::vector<Fault> faults;
    for (const auto& one : switched) faults.push_back(one.fault);
    return faults;
  }
  Result<std::vector<std::size_t>> named(Target::Kind kind, std::string_view name) const;
  Status apply_to(Target::Kind kind, std::string_view name, std::string_view rest);
  template <typename Fault>
  Status apply_fault(std::vector<std::vector<Switched<Fault>>>& all, std::string_view name, std::string_view rest,
                     Result<Fault> (*parse)(std::string_view));
  std::vector<Target> targets_;
  ReadRecording read_;
  ReadLinkRecording read_link_recording_;
  std::vector<std::vector<Switched<SensorFault>>> sensors_;
  std::vector<std::vector<Switched<SdkFault>>> sdk_;
  std::size_t items_ = 0;
  std::vector<std::array<Impairment, ways>> impairments_;
  std::vector<bool> cut_;
};

/// A command at a time after the proxy's start; `for_ns` later what it switched is switched off again.
struct ScheduledFault {
  TimeNs at_ns = 0;
  std::optional<TimeNs> for_ns;
  std::string command;
};

/// Commands in the order of their time, checked as a whole before the first one is due. A core; one thread.
class CommandSchedule {
 public:
  /// The error names the command that cannot be, or one that overlaps another of the same effect: the end of the one
  /// would end the other. `which` is then the fault's index.
  static Result<CommandSchedule> make(const std::vector<ScheduledFault>& faults, Switches switches,
                                      std::size_t* which = nullptr);

  /// The next command that is due at `since_start`; call until there is none.
  std::optional<std::string> pop(TimeNs since_start);
  std::optional<TimeNs> next() const;

 private:
  struct Command {
    TimeNs at_ns = 0;
    bool on = false;        ///< not the end of another
    bool lasts = false;     ///< until an end of its own
    std::size_t fault = 0;  ///< its index
    std::string text;
  };
  std::vector<Command> commands_;
  std::size_t done_ = 0;
};

/// The commands that switched something, for a summary: the first 10,000, and how many more. A core; one thread.
class SwitchedCommands {
 public:
  void add(TimeNs at_ns, std::string command);
  /// Into "switched" and "switched_unnamed".
  void report_to(nlohmann::json& summary) const;

 private:
  std::vector<std::pair<TimeNs, std::string>> named_;
  std::uint64_t unnamed_ = 0;
};

/// The command that switches off what this one switched on; an error where there is no such command (`cut`, `clear`).
Result<std::string> opposite(std::string_view command);

}  // namespace ledgerline::hil::proxy
