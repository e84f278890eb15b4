#pragma once
#include <sys/types.h>

#include <memory>
#include <string>
#include <vector>

#include "common/rt/trace.hpp"
#include "hil/fault/script.hpp"

namespace ledgerline::hil {

/// A trace that grows, and starts again when its program does.
class GrowingTrace {
 public:
  explicit GrowingTrace(std::string path) : path_(std::move(path)) {}
  /// What is new; nothing while there is no file.
  std::vector<TraceRecord> read_new();

 private:
  std::string path_;
  std::unique_ptr<TraceReader> reader_;
  ino_t inode_ = 0;
};

/// What triggers look at, as far as the traces in the folder of a flight show it while they grow. One thread.
class LiveFacts {
 public:
  LiveFacts(const std::string& run, const Script& script);
  void read();
  const std::vector<DroneFacts>& facts() const { return facts_; }
  TimeNs begin_ns() const { return begin_ns_; }  ///< link's first record; 0: none yet

 private:
  DroneFacts* of(const TraceRecord& r) {
    return r.drone >= 1 && r.drone <= facts_.size() ? &facts_[r.drone - 1u] : nullptr;
  }
  GrowingTrace sim_, link_, ground_;
  bool by_sdk_;                ///< neither link nor ground
  std::vector<double> lap_m_;  ///< by drone
  std::vector<DroneFacts> facts_;
  TimeNs begin_ns_ = 0;
};

}  // namespace ledgerline::hil
