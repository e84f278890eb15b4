#pragma once
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "chaincode/network/options.hpp"
#include "chaincode/network/processes/orderer_watch.hpp"
#include "chaincode/network/processes/processes.hpp"
#include "common/base/result.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::network {

/// Limit for a process of this host to start and to answer.
inline constexpr TimeNs starting_limit_ns = 20 * ns_per_s;

/// This host's part of a network, as the steps of its set-up share it: its directory with what is done already, its
/// addresses and its processes. One thread, which must outlive all others (Children).
class Site {
 public:
  explicit Site(Options options);
  Site(const Site&) = delete;
  Site& operator=(const Site&) = delete;

  /// Checks options and programs, makes the directory, and goes on with what it has: fabric-ca and addresses. Before
  /// anything else.
  Status open();

  const Options& options() const { return options_; }
  const ListenAddresses& addresses() const { return addresses_; }
  std::string in(const std::string& name) const { return options_.dir + "/" + name; }
  std::string tool(const std::string& program) const { return options_.tools + "/" + program; }
  /// Organisations or orderers of which this host runs the processes.
  std::vector<int> own_organisations() const;
  std::vector<int> own_orderers() const;

  /// Runs `step` where the directory does not say that it is done, and marks it when it succeeds.
  Status once(const std::string& name, const std::function<Status()>& step);
  Status once_per_channel(const std::string& name, const std::function<Status(const std::string& channel)>& step);

  Processes& processes() { return *processes_; }
  const Processes& processes() const { return *processes_; }
  /// Looks after the processes for so long: an orderer that hangs at its start is ended, and what ended is started
  /// again once they are supervised. An error: one ended too often.
  Status poll(TimeNs duration);
  /// Ends all processes. False: one of them had to be killed.
  bool stop() { return !processes_ || processes_->stop(); }
  /// What one of this host's orderers says of itself; empty: it does not listen yet.
  std::map<std::string, RaftSign> signs_of(int orderer) const;

  /// How long a part on any host is waited for.
  TimeNs timeout() const { return options_.several_hosts() ? options_.timeout_ns : starting_limit_ns; }
  Status run_until_good(const std::string& what, const std::vector<std::string>& command,
                        const std::vector<std::string>& environment, const std::string& good_too = {});
  /// The peer's command with these words, as the administrator of its organisation, until it succeeds.
  Status call_peer(const std::string& what, int organisation, std::vector<std::string> words,
                   const std::string& good_too = {});
  /// A client of this organisation's administrator.
  Result<std::unique_ptr<fabric::Client>> connect(int organisation, const std::string& channel) const;

 private:
  Options options_;
  ListenAddresses addresses_;
  std::unique_ptr<Processes> processes_;
  OrdererWatch watch_;
};

/// Identities of all members, made here or by fabric-ca's servers, which are then among the site's processes; and the
/// scripts with which peers build chaincode packages. What the directory has stays.
Status make_crypto_material(Site& site);

// The network's channels, each step once: what a directory has done already is not done again.

/// configtx.yaml and each channel's first block.
Status make_first_blocks(Site& site);
/// This host's orderers and peers, which run, join all channels.
Status join_orderers(Site& site);
Status join_peers(Site& site);
/// Until an orderer leads each channel: after a restart peers answer before the orderers have elected. Where other
/// hosts run orderers too, the leader may be theirs, and cannot be seen from here.
Status wait_for_leader(Site& site);

struct Counts {
  std::uint64_t blocks = 0, transactions = 0;
};
/// What a peer of this host has committed on all channels, the config block and the deployment among it.
Result<Counts> count_blocks(Site& site);

}  // namespace ledgerline::network
