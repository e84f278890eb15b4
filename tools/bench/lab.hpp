#pragma once
#include <atomic>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/process/children.hpp"
#include "tools/bench/exchange.hpp"
#include "tools/bench/metrics.hpp"

namespace ledgerline::bench {

/// Where everything is.
struct LabPaths {
  std::filesystem::path dir;       ///< of networks and clients, made here
  std::filesystem::path programs;  ///< ledgerline, ledgerline-node, two_way_client
  std::filesystem::path fabric;    ///< Fabric's own programs
  std::filesystem::path node;      ///< Node.js
  std::filesystem::path script;    ///< node/client.cjs
  std::filesystem::path npm;       ///< node_modules is in it
  bool embedded = false;           ///< ledgerline-node in place of Fabric
  std::vector<std::string>
      network_options;  ///< more words for `ledgerline fabric run`, for the networks of all clients
  double poll_ms = 10;  ///< between an answer and the next question, polling
};

/// A ledger of its own, from up() to the destructor. One thread, which must outlive all others (Children).
class Network {
 public:
  struct Settings {
    int orderers = 1;
    int batch_count = 1;
    int batch_timeout_ms = 10;
    bool peers_in_background = false;  ///< nobody waits for them: of Fabric alone
    bool operator==(const Settings&) const = default;
  };
  /// Competitors of equal ones may share a network.
  static Settings settings_for(const Competitor& competitor);

  Network(LabPaths paths, Settings settings, std::filesystem::path dir, const std::atomic<int>& interrupts);
  ~Network();
  /// From nothing until its contract answers, with names enrolled for both sides.
  Status up();
  /// Ends it and says what it says of itself: blocks, transactions, storage.
  Result<nlohmann::json> down();

  /// CPU time of all of its processes so far.
  double cpu_seconds() const;
  /// The folder of that organisation's own endorser, with its identity and what it serves by.
  std::filesystem::path endorser_dir(int organisation) const;
  /// Its config as a program.
  std::string endorser_config(int organisation, const std::filesystem::path& summary) const;

  /// What a client of organisation 1 (side a) or 2 (side b) needs.
  struct Access {
    std::string endpoint, tls_ca, msp_id, msp_dir, orderer_tls_ca;
    std::string config_block;  ///< the channel's first, a file
    std::vector<std::string> orderers;
    struct Endorser {
      std::string endpoint, tls_ca;
    };
    std::vector<Endorser> endorsers;  ///< the organisation's own peer and another's: a majority
  };
  Access access(int organisation, const std::string& user = "User1") const;

 private:
  Status wait_for_line(const std::string& name, TimeNs limit_ns);
  Status enroll();

  LabPaths paths_;
  Settings settings_;
  std::filesystem::path dir_;
  const std::atomic<int>& interrupts_;
  std::string name_, ready_;
  std::vector<std::string> peers_, endorsers_, orderers_;
  Children children_;
};

/// Both clients of a competitor on a network, once. An error: they did not start, or it was interrupted; whatever
/// happens later is in the run.
Result<Turn> exchange(const LabPaths& paths, const Network& network, const Competitor& competitor,
                      const Schedule& schedule, const std::filesystem::path& dir, const std::atomic<int>& interrupts);

}  // namespace ledgerline::bench
