#pragma once
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/options.hpp"
#include "chaincode/network/processes/processes.hpp"
#include "chaincode/network/processes/start_check.hpp"
#include "common/base/result.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::fabric_network {

/// A running network: orderers, peers and chaincode services as children of this process, which end with it, however it
/// ends. A directory keeps its identities, ledgers and places: a second up() goes on where the last one ended. With
/// Options::only it is this host's part of a network that several hosts run. One thread, which must be the one that
/// lives longest (Children).
class Network {
 public:
  explicit Network(Options options);

  /// Identities, places and the channels' first blocks, once; each host of several gets a copy of the directory.
  Status prepare();
  /// From nothing, or from what is in the directory, to a network whose contract answers. An error names the step, and
  /// has the last log lines of what failed.
  Status up();
  /// Looks after the processes for so long: one that ended is started again. An error: it ended too often.
  Status tend(TimeNs duration);
  /// Ends all, peers first. False: one of them had to be killed.
  bool down() { return !processes_ || processes_->stop(); }

  const Options& options() const { return options_; }
  const ListenAddresses& places() const { return places_; }
  /// In the order of their start: "orderer1", "peer1", "chaincode1", ...
  std::vector<Processes::State> processes() const { return processes_->states(); }
  /// What a peer of this host has committed on all channels, the config block and the deployment among it.
  struct Counts {
    std::uint64_t blocks = 0, transactions = 0;
  };
  Result<Counts> count();

 private:
  void watch_orderers();
  Status look_at_directory();
  Status check_room();
  Status make_identities();
  Status issue_identities(const identities::Hosts& hosts);
  Status choose_places();
  Status check_ports();
  Status make_first_blocks();
  Status make_packages();
  Status start_processes();
  Status join_orderers();
  Status join_peers();
  Status start_chaincodes();
  Status install();
  Status deploy();
  Status wait_for_contract();
  Status wait_for_leader();
  std::map<std::string, RaftSign> signs_of(int orderer) const;
  Status enroll_first();
  Status for_each_channel(const std::string& step, Status (Network::*make)(const std::string& channel));
  Status make_first_block(const std::string& channel);
  Status join_orderers_to(const std::string& channel);
  Status join_peers_to(const std::string& channel);
  Status deploy_on(const std::string& channel);
  Status enroll_first_on(const std::string& channel);
  Result<Counts> count_on(const std::string& channel);
  Result<std::unique_ptr<fabric::Client>> connect(int organisation, const std::string& user,
                                                  const std::string& channel) const;

  std::string in(const std::string& name) const { return options_.dir + "/" + name; }
  std::string first_block_of(const std::string& channel) const { return in(channel + ".block"); }
  /// Organisations or orderers of which this host runs the processes.
  std::vector<int> own_organisations() const;
  std::vector<int> own_orderers() const;
  bool marked(const std::string& step) const;
  Status mark(const std::string& step);
  Status run_until_good(const std::string& what, const std::vector<std::string>& command,
                        const std::vector<std::string>& environment, const std::string& good_too = {});

  Options options_;
  ListenAddresses places_;
  std::map<int, std::string> package_ids_;
  std::unique_ptr<Processes> processes_;
  struct Watched {
    pid_t pid = 0;
    std::optional<StartCheck> check;  ///< none: it takes part
  };
  std::map<std::string, Watched> watched_;  ///< orderers since their last start
  TimeNs next_watch_ = 0;
};

}  // namespace ledgerline::fabric_network
