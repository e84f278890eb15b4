#pragma once
#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/process/children.hpp"
#include "common/process/restarts.hpp"
#include "tools/launcher/configs.hpp"
#include "tools/launcher/live.hpp"
#include "tools/launcher/options.hpp"
#include "tools/launcher/preflight/preflight.hpp"
#include "tools/launcher/switches/switch_service.hpp"

namespace ledgerline::timing {
struct UsageRecord;
}
namespace ledgerline::fly {

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
  Status start_ledger();
  Status prepare_ledger();
  Status look_at_leases(const deployment::OwnLedger& network);
  Status enroll_and_acquire();
  Status enroll_operators();
  /// `other_program`: without "ledgerline-", where it is not the first part of the name.
  Status start(const std::string& name, std::vector<std::string> arguments, const std::string& other_program = {});
  Status goes_well_so_far() const;  ///< before take-off: nobody has ended, and nobody wants it to end
  Status wait_ready(const std::vector<std::string>& names);
  Status run_to_end(const std::string& name, std::vector<std::string> arguments);
  Status start_endorser(LedgerPlaces& places);
  Status start_proxy(const LedgerPlaces& places, Proxied& proxied);
  Status fly();
  void write_usage(const timing::UsageRecord& usage);
  Status supervise_onboard(TimeNs now_ns);
  bool is_impatient() const { return interrupts_ > 1; }  ///< Ctrl-C twice: no drone is awaited
  bool serves(const std::string& name) const { return children_.running(name) && ready_.contains(name); }
  bool may_start(const std::string& name) const;
  bool controller_comes_back() const;
  Status start_again(const std::string& name);
  void recycle_shared_memory();
  void stop_all(bool landed);
  void take_line(const std::string& name, const std::string& line);
  void tell_page(const std::string& url);
  void ended_early(const std::string& name);
  std::string crash_of(const std::string& name, const std::string& when) const;
  std::string ground_why() const;

  Options options_;
  RunFiles files_;
  std::string programs_;
  const std::atomic<int>& interrupts_;
  Live live_;
  Preflight preflight_;
  Children children_;
  std::unique_ptr<SwitchService> switches_;   ///< null: the page has none
  std::string records_;                       ///< as control-show printed them
  std::map<std::string, std::string> ready_;  ///< the line that a program said it serves with
  RunRecord record_;
  std::vector<Onboard> onboard_;  ///< in the order of their start: RouDi before those that need it
  bool chunks_leaked_ = false;    ///< as RouDi says
  bool endorser_gone_ = false;
  bool link_given_up_ = false;                   ///< killed here, for a new RouDi
  const std::string ledger_;                     ///< the process that is the ledger: node or fabric; empty: none
  const std::string controller_;                 ///< ground; local without a ledger
  const std::vector<std::string> all_programs_;  ///< that live through the flight
};

}  // namespace ledgerline::fly
