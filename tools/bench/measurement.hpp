#pragma once
#include <atomic>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/bench/lab.hpp"

namespace ledgerline::bench {

/// What was asked.
struct Options {
  std::vector<int> rates{30, 70, 110, 250, 1000};
  std::vector<std::string> clients;
  double seconds = 20, warm_up_s = 10, drain_s = 10;
  int alternations = 5;
  std::string ledger = "fabric", dir, json;
  LabPaths paths;
};

/// A benchmark's result: `head`, `machine`, and each of the runs on a line of its own. To `file`; empty: nowhere.
Status write_result(const std::string& file, nlohmann::json head, const std::vector<nlohmann::json>& runs);
/// Those of any benchmark, as their to_json() has them.
template <typename Run>
std::vector<nlohmann::json> lines_of(const std::vector<Run>& runs) {
  std::vector<nlohmann::json> lines;
  for (const Run& run : runs) lines.push_back(to_json(run));
  return lines;
}

/// Every competitor at every rate, repeatedly; networks come up and go down as they are needed. What was measured
/// stays when it fails or is interrupted.
class Measurement {
 public:
  /// Both must outlive it.
  Measurement(const Options& options, const std::atomic<int>& interrupts) : o_(options), interrupts_(interrupts) {}

  Status run();
  const std::vector<Turn>& runs() const { return runs_; }
  const std::string& storage() const { return storage_; }  ///< "disk" or "tmpfs"
  /// To Options::json, if that is asked for.
  Status write_json() const;

 private:
  Status group(const std::vector<const Competitor*>& competitors, int rate, int alternation);
  Status end(Network& network, const Network::Settings& settings);
  void log(const Turn& run) const;

  const Options& o_;
  const std::atomic<int>& interrupts_;
  std::string storage_;
  int directories_ = 0, position_ = 0;
  std::vector<Turn> runs_;
  nlohmann::json networks_ = nlohmann::json::array();
};

}  // namespace ledgerline::bench
