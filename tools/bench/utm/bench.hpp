#pragma once
#include <atomic>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/bench/measurement.hpp"
#include "tools/bench/utm/figures.hpp"
#include "tools/bench/utm/workload.hpp"

namespace ledgerline::utm {

/// What was asked. `common` has the place, ledger, clients, rates, times and alternations as two-way has them.
struct Options {
  two_way::Options common;
  WorkloadOptions workload;
  bool evenly = false;
  std::vector<std::string> settings{"ours", "stock"};
  int attempts = 6;
};

/// What a network of these settings cuts a block by. `stock`: what Fabric's sample configuration has, 500 messages / 2 s.
two_way::Network::Settings settings_of(const std::string& name);

/// Every contender at every rate on each of the settings, again and again, every other time in reverse order. Those of
/// the same settings and alternation share a network. What was measured stays when it fails or is interrupted.
class Bench {
 public:
  /// Both must outlive it.
  Bench(const Options& options, const std::atomic<int>& interrupts) : o_(options), interrupts_(interrupts) {}

  Status run();
  const std::vector<Turn>& runs() const { return runs_; }
  const std::string& storage() const { return storage_; }
  Status write_json() const;

 private:
  Status on_network(const std::string& settings, int alternation);
  Result<Turn> turn(const two_way::Network& network, const std::string& contender, int rate, int alternation);

  const Options& o_;
  const std::atomic<int>& interrupts_;
  std::string storage_;
  std::vector<Turn> runs_;
  nlohmann::json networks_ = nlohmann::json::array();
};

}  // namespace ledgerline::utm
