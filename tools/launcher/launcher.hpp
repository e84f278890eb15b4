#pragma once
#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/process/children.hpp"
#include "tools/launcher/configs.hpp"
#include "tools/launcher/fault_switches.hpp"
#include "tools/launcher/live.hpp"
#include "tools/launcher/options.hpp"
#include "tools/launcher/preflight.hpp"

namespace ledgerline::timing {
struct UsageRecord;
}
namespace ledgerline::launcher {

/// How a run went, as the launcher saw it.
struct RunRecord {
  bool ok = false;
  std::string why;                  ///< when not ok
  TimeNs begin_ns = 0, end_ns = 0;  ///< of the flight: all programs serve, until ground ended
  std::map<std::string, double> cpu_percent;
  std::map<std::string, double> memory_mb;        ///< proportional set size, as last seen
  std::map<std::string, std::uint64_t> restarts;  ///< of RouDi, link and agent, during the flight
  /// Programs that ended unasked during the flight, and how; each time.
  std::vector<std::pair<std::string, std::string>> ended_early;
  std::uint64_t ledger_grown_bytes = 0;  ///< of the ledger's directory, during the flight
};

/// The child that prints the control records of a ledger of others.
inline const std::string records_program = "control-show";

/// The processes of a flight, each with a log and a config of its name in the run's folder. One thread.
class Programs : public Children {
 public:
  /// `folder`: where the programs are. `on_line`: each line that one prints, beside the one that says it serves.
  Programs(
      const Options& options, const RunFiles& files, std::string folder, const std::atomic<int>& interrupts,
      std::function<void(const std::string& name, const nlohmann::json& message, const std::string& line)> on_line);

  /// `other_program`: the service or verb, where it is not the first part of the name.
  Status start(const std::string& name, std::vector<std::string> arguments, const std::string& other_program = {});
  /// Before take-off: no program has ended, and no Ctrl-C came.
  Status check() const;
  Status wait_ready(const std::vector<std::string>& names);
  Status run_to_end(const std::string& name, std::vector<std::string> arguments);
  /// The same when the flight is over, which Ctrl-C has ended perhaps.
  Status run_after_flight(const std::string& name, std::vector<std::string> arguments);

  bool is_ready(const std::string& name) const { return ready_.contains(name); }
  bool is_impatient() const { return interrupts_ > 1; }  ///< Ctrl-C twice: no drone is awaited
  bool serves(const std::string& name) const { return is_running(name) && is_ready(name); }
  /// The JSON object, in one line, that a program said it serves with; it is_ready().
  const std::string& ready_line(const std::string& name) const { return ready_.at(name); }
  void expect_again(const std::string& name) { ready_.erase(name); }  ///< it has to become ready once more
  std::string crash_of(const std::string& name, const std::string& when) const;
  std::string why_controller_ended() const;

 private:
  void on_output(const std::string& name, const std::string& line);
  Status wait_for_end(const std::string& name, const std::string& when, const std::function<bool()>& gives_up);

  const Options& options_;
  const RunFiles& files_;
  const std::string folder_;
  const std::atomic<int>& interrupts_;
  const std::function<void(const std::string& name, const nlohmann::json& message, const std::string& line)> on_line_;
  std::map<std::string, std::string> ready_;
};

/// A flight's ledger: starts it with all between it and the programs, and sees to it that drones and operators are
/// enrolled and the drones acquired. What is passed to it must outlive it. One thread.
class FlightLedger {
 public:
  FlightLedger(const Options& options, const RunFiles& files, Programs& programs, Preflight& preflight, Live& live)
      : options_(options), files_(files), programs_(programs), preflight_(preflight), live_(live) {}

  /// The process that is the ledger: node or fabric; empty: none is started.
  const std::string& program() const { return program_; }
  Status start();
  /// It is ready: configs for all, the endorser, the proxy, enrolments, leases.
  Status prepare();
  /// On a network of others, once no program of the flight is left: the leases that prepare() acquired are free again.
  void give_back();
  void set_records(const std::string& line) { records_ = line; }  ///< as control-show printed them
  SwitchService* switches() { return switches_.get(); }           ///< null: the page has none
  void end_switches() { switches_.reset(); }

 private:
  Status check_leases(const deployment::OwnLedger& network);
  Status enroll_and_acquire();
  Status enroll_operators();
  Status start_endorser(LedgerEndpoints& endpoints);
  Status start_proxy(const LedgerEndpoints& endpoints, Proxied& proxied);

  const Options& options_;
  const RunFiles& files_;
  Programs& programs_;
  Preflight& preflight_;
  Live& live_;
  const std::string program_ = ledger_program(options_);
  std::string records_;
  std::vector<std::string> acquired_;  ///< drones of a network of others whose leases we did not have before
  std::unique_ptr<SwitchService> switches_;
};

/// Starts the programs of a flight, watches them, and ends every one of them, whatever happens:
///
///     roudi, ledger, sim, proxy (where asked for)  ->  enroll, acquire  ->  link, agent, ground  ->  ground ends  ->
///     agent, link, proxy, sim, ledger, roudi
///
/// A deployment's own drones: no sim, and ground once all of them could take off.
/// Without a ledger: roudi, sim -> link, local -> local ends -> link, sim, roudi; nothing is started again.
/// RouDi, link and agent are started again when they end in flight, each a bounded number of times; any other one's end
/// ends the flight. docs/failsafe.md says what each death means for a drone in the air.
///
/// `interrupts` counts Ctrl-C: the first one lands the drones, a second one does not wait for that.
class Launcher {
 public:
  Launcher(Options options, RunFiles files, std::string programs, bool terminal, const std::atomic<int>& interrupts);

  RunRecord run();

 private:
  /// One that is started again when it ends.
  struct Onboard {
    std::string name;
    Restarts restarts;
    TimeNs start_at_ns = 0;  ///< > 0: it has ended and waits
  };

  Status start_all();
  Status start_local();
  Status wait_for_drones();
  Status start_sim();
  Status fly();
  void write_usage(const timing::UsageRecord& usage);
  Status supervise_onboard(TimeNs now_ns);
  bool may_start(const std::string& name) const;
  bool is_controller_restarted() const;
  Status start_again(const std::string& name);
  void recycle_shared_memory();
  void stop_all(bool landed);
  void on_line(const std::string& name, const nlohmann::json& message, const std::string& line);
  void show_page(const std::string& url);
  /// What a device needs that is not this computer: the certificate's fingerprint, and on a terminal a QR code.
  void show_access_of_others(const std::string& page);
  void record_early_end(const std::string& name);

  Options options_;
  RunFiles files_;
  const std::atomic<int>& interrupts_;
  Live live_;
  Preflight preflight_;
  Programs programs_;
  FlightLedger ledger_;
  RunRecord record_;
  std::vector<Onboard> onboard_;  ///< in the order of their start: RouDi before those that need it
  bool chunks_leaked_ = false;    ///< as RouDi says
  bool endorser_gone_ = false;
  bool link_given_up_ = false;                   ///< killed here, for a new RouDi
  const std::string controller_;                 ///< ground; local without a ledger
  const std::string runtime_folder_;             ///< of this user
  const std::vector<std::string> all_programs_;  ///< that live through the flight
};

}  // namespace ledgerline::launcher
