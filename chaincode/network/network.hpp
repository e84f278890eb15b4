#pragma once
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "chaincode/network/options.hpp"
#include "chaincode/network/processes/processes.hpp"
#include "chaincode/network/setup/deployment.hpp"
#include "chaincode/network/setup/site.hpp"
#include "common/base/result.hpp"

namespace ledgerline::network {

/// A running network: orderers, peers and chaincode services as children of this process, which end with it, however it
/// ends. A directory keeps its identities, ledgers and addresses: a second up() goes on where the last one ended. With
/// Options::only it is this host's part of a network that several hosts run. One thread, which must outlive all
/// others (Children).
class Network {
 public:
  explicit Network(Options options) : site_(std::move(options)) {}

  /// Identities, addresses and the channels' first blocks, once; each host of several gets a copy of the directory.
  Status prepare();
  /// From nothing, or from what is in the directory, to a network whose contract answers. An error names the step, and
  /// has the last log lines of what failed.
  Status up();
  /// Looks after the processes for so long: one that ended is started again. An error: it ended too often.
  Status poll(TimeNs duration) { return site_.poll(duration); }
  /// Ends all, peers first. False: one of them had to be killed.
  bool down() { return site_.stop(); }

  const Options& options() const { return site_.options(); }
  const ListenAddresses& addresses() const { return site_.addresses(); }
  /// In the order of their start: "orderer1", "peer1", "chaincode1", ...
  std::vector<Processes::State> processes() const { return site_.processes().states(); }
  Result<Counts> count() { return count_blocks(site_); }

 private:
  Status check_own_address();
  Status check_room();
  Status start_orderers_and_peers();

  Site site_;
  Deployment deployment_{site_};
};

/// Brings the network that runs in options.dir, or this host's part of it, to options.chaincode, the contract of this
/// version, while it serves: its organisations approve the next definition, the host of the first one commits it, and
/// then the chaincode services end, to be started again by the network's process from the program that has taken the
/// place of theirs. Where all is done already it does nothing. Must be called on the thread that outlives
/// all others (Children).
Status upgrade(Options options);

/// DIR/network.json: held (flock) by the network's process as long as it lives, however it ends; its text is what
/// `status` shows. One thread.
class RunFile {
 public:
  explicit RunFile(const std::string& dir) : path_(dir + "/network.json") {}
  ~RunFile();
  RunFile(const RunFile&) = delete;
  RunFile& operator=(const RunFile&) = delete;

  /// False: another process holds it.
  bool lock();
  bool write(const std::string& text) const;
  /// What a living network says of itself, an empty object while it starts; nullopt: none runs.
  std::optional<nlohmann::json> read() const;

 private:
  std::string path_;
  int fd_ = -1;
};

}  // namespace ledgerline::network
