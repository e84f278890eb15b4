#pragma once
#include <map>
#include <string>
#include <vector>

#include "chaincode/fabric/options.hpp"
#include "common/fabric/client.hpp"
#include "common/process/children.hpp"
#include "common/rt/result.hpp"

namespace ledgerline::fabric_network {

/// A running network: orderers, peers and chaincode services as children of this process, which end with it, however it
/// ends. A directory keeps its identities, ledgers and ports: a second up() goes on where the last one ended. One
/// thread, which must be the one that lives longest (Children).
class Network {
 public:
  explicit Network(Options options);

  /// From nothing, or from what is in the directory, to a network whose contract answers. An error names the step, and
  /// has the last log lines of what failed.
  Status up();
  /// Looks after the processes for so long. An error: one of them has ended.
  Status tend(TimeNs duration);
  /// Ends all, peers first. False: one of them had to be killed.
  bool down();

  const Options& options() const { return options_; }
  const Ports& ports() const { return ports_; }
  /// What the first peer has committed, the config block and the deployment among it.
  struct Counts {
    std::uint64_t blocks = 0, transactions = 0;
  };
  Result<Counts> count();
  /// User and system time of each process so far, by name ("peer1", "orderer1", "chaincode1").
  std::map<std::string, double> cpu_seconds() const;

 private:
  Status prepare();
  Status choose_ports();
  Status make_genesis();
  Status make_packages();
  Status start_orderers();
  Status start_peers();
  Status start_chaincodes();
  Status deploy();
  Status wait_for_contract();
  Status enroll_first();
  Result<std::unique_ptr<fabric::Client>> connect(int organisation, const std::string& user) const;

  std::string in(const std::string& name) const { return options_.dir + "/" + name; }
  bool marked(const std::string& step) const;
  Status mark(const std::string& step);
  Status start(const std::string& name, std::vector<std::string> command, std::vector<std::string> environment);
  /// Runs a command to its end; what it printed. `what` is for errors.
  Result<std::string> run(const std::string& what, std::vector<std::string> command,
                          std::vector<std::string> environment);
  /// The same until it succeeds, at most so long: the other side is just starting.
  Status run_until_good(const std::string& what, const std::vector<std::string>& command,
                        const std::vector<std::string>& environment);
  std::string log_of(const std::string& name) const { return in("logs/" + name + ".log"); }

  Options options_;
  Ports ports_;
  std::map<int, std::string> package_ids_;
  std::vector<std::string> services_;  // in the order of their start
  std::map<std::string, std::string> output_;
  int commands_ = 0;
  Children children_;
};

}  // namespace ledgerline::fabric_network
