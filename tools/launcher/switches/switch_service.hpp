#pragma once
#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/base/result.hpp"
#include "common/program/socket/command_socket.hpp"
#include "tools/launcher/switches/fault_switches.hpp"

namespace ledgerline::fly {

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

}  // namespace ledgerline::fly
