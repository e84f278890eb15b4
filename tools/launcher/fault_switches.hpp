#pragma once
#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "common/base/result.hpp"
#include "common/program/command_socket.hpp"

namespace ledgerline::launcher {

/// The faults of a simulated flight that people switch at ground's page, and which of them are on. A core without I/O;
/// one thread. Commands, one line each:
///
///     list         changes nothing
///     on NAME      such as silent-tello1
///     off NAME
///
/// The answer to each is list().
class FaultSwitches {
 public:
  explicit FaultSwitches(const std::vector<std::string>& drones);

  /// What a command, or an end, has the proxy do.
  struct Step {
    std::size_t which = 0;
    bool on = false;
    std::string line;  ///< a command of hil/proxy/switches.hpp
  };
  /// Nothing: the command changes nothing. What is on already is sent to the proxy again: somebody else may have
  /// cleared it.
  Result<std::optional<Step>> step_of(std::string_view command) const;
  /// The proxy gets the command: it may act on what it does not answer in time.
  void on_sent(const Step& step) { all_[step.which].may_be_on |= step.on; }
  /// The proxy has done it.
  void on_done(const Step& step) { all_[step.which].on = all_[step.which].may_be_on = step.on; }
  /// Commands that switch off everything that is, or may be, on.
  std::vector<Step> steps_off() const;
  /// From here on nothing is switched on.
  void end() { ended_ = true; }
  /// One line of JSON: {"faults":[{"name":"silent-tello1","drone":"tello1","label":"Drone
  /// silent","words":"...","on":false}]}; `drone` is empty for what is of all.
  std::string list() const;

 private:
  struct Switch {
    std::string name, drone, label;
    std::string words;  ///< what it does, and what comes of it
    std::string line;   ///< switches it on
    bool on = false, may_be_on = false;
  };
  Result<Step> step(std::size_t which, bool on) const;

  std::vector<Switch> all_;
  bool ended_ = false;
};

/// The shell around FaultSwitches: serves them on a Unix socket, and commands the proxy, on a thread of its own. When
/// it ends, and when the launcher does, however it does, nothing is left on: the proxy does not outlive the launcher.
class SwitchService {
 public:
  /// `proxy`: the path of its socket.
  static Result<std::unique_ptr<SwitchService>> open(const std::string& socket, std::string proxy,
                                                     const std::vector<std::string>& drones);
  /// Switches all off, for some seconds at most where the proxy does not answer.
  ~SwitchService();

  /// All are switched off soon. Any thread.
  void all_off() { off_ = true; }
  /// The same, and nothing is switched on any more. Any thread.
  void end() { ending_ = true; }

 private:
  SwitchService(CommandSocket socket, std::string proxy, const std::vector<std::string>& drones);
  void serve();
  Result<std::string> act(const std::string& command);
  void switch_off();

  CommandSocket socket_;
  const std::string proxy_;
  FaultSwitches switches_;
  std::atomic<bool> off_{false}, ending_{false}, over_{false};
  std::thread thread_;  ///< uses all of the above
};

}  // namespace ledgerline::launcher
