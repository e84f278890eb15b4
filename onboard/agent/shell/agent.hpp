#pragma once
#include <array>
#include <atomic>
#include <future>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

#include "common/fabric/tls/certificate_watch.hpp"
#include "common/program/program.hpp"
#include "common/program/service_manager.hpp"
#include "onboard/agent/shell/shell.hpp"

namespace ledgerline::agent {

/// The agent as a process: an AgentShell for each channel, and what they share, which is the iceoryx end, RouDi's
/// watch, trace, status and summary. One main loop: it waits for the mailboxes, for link, which wakes it behind each
/// state, and for the moment at which a batch or heartbeat is due; it has no period.
class Agent {
 public:
  /// `settings`: of the process. `quit` is watched everywhere and must outlive the agent. At least one channel, whose
  /// drones differ in number.
  Agent(Settings settings, std::vector<std::unique_ptr<AgentShell>> channels, const std::atomic<bool>& quit);

  /// RouDi, then all channels side by side, with a bounded wait and a message that names the cure. The drones of a
  /// channel that is up are flown from then on. Of several channels one must be reached: the others are
  /// reported, and join when they are reached.
  Status start();
  /// Until `quit`; or until RouDi is gone, and link, too, or on the ground. Then waits a moment for calls in flight,
  /// and writes the summary.
  Status run();
  /// Has renewed certificates taken while it runs. Before start().
  void watch_certificates(std::unique_ptr<fabric::CertificateWatch> watch) { certificates_ = std::move(watch); }

 private:
  struct Slot {
    std::unique_ptr<AgentShell> shell;
    std::future<Status> reaching{};  ///< valid: another thread has the shell
    bool up() const { return !reaching.valid(); }
  };

  void watch_roudi(const std::stop_token& stop);
  bool cut_off(TimeNs now) const;
  Status reach_channels();
  void begin();
  void wait();
  Status turn();
  void receive_from_link();
  void run_periodic_tasks(TimeNs now);
  void drain();
  Status write_summary();

  Settings settings_;
  const std::atomic<bool>& quit_;
  std::unique_ptr<ipc::AgentEnd> end_;
  Recorder recorder_;
  std::optional<ServiceManager> manager_;
  std::uint64_t turns_ = 0;
  TimeNs flight_heard_ns_ = 0;  ///< newest state of a drone in the air
  TimeNs next_status_ns_ = 0;
  bool is_begun_ = false;
  bool link_woke_ = false;  ///< in this turn
  std::atomic<bool> roudi_gone_{false};
  std::array<Slot*, max_drones + 1> of_drone_{};  ///< null: nobody's

  // Last: their threads end first.
  std::vector<Slot> channels_;
  std::jthread roudi_watch_;
  std::unique_ptr<fabric::CertificateWatch> certificates_;
};

}  // namespace ledgerline::agent
