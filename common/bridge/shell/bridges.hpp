#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/bridge/shell/bridge.hpp"

namespace ledgerline::bridge {

/// Logs which topics are taken from the ledger from any writer (from = "*"). Once, at a program's start.
void warn_of_open_topics(const BridgeConfig& config);

/// All that a program bridges: a Bridge for each channel that a topic names. One thread.
class Bridges {
 public:
  /// `ledgers`: that of [ledger], then those of the program's own further channels; any other channel is asked for
  /// where that of [ledger] is. `trusted` must outlive it.
  static Result<std::unique_ptr<Bridges>> create(const BridgeConfig& config,
                                                 const std::vector<fabric::ClientConfig>& ledgers,
                                                 crypto::MspRegistry& trusted, const dds::ParticipantPtr& participant);

  /// Begins, and carries until `quit`. Each `status_period_ns`, and at the end, the status is written to the file that
  /// the config names, whole at any moment, and then passed to `tell`: {bridge, pid, time_ns, period_ms, channels}, a
  /// line of JSON.
  Status run(const std::atomic<bool>& quit, const std::function<void(const std::string& status)>& tell);

 private:
  explicit Bridges(const BridgeConfig& config) : config_(config) {}
  Status write_status(const std::function<void(const std::string& status)>& tell);

  const BridgeConfig config_;
  std::vector<std::unique_ptr<Bridge>> bridges_;
};

/// Bridges beside a program's own work: with a thread, connections and block streams of their own, so that nothing of
/// the program waits for them. What fails is logged and tried again, a second later at first, then up to 30 s
/// (BackOff), for as long as the program lives. Ends with the object.
class BesideBridges {
 public:
  /// Null where the config names no [[topic]]. `config` is that of the program, checked already; `program`: its
  /// clients', with whom the bridge's are renewed.
  static Result<std::unique_ptr<BesideBridges>> create(Config& config, const fabric::ClientConfig& program,
                                                       BridgeConfig bridge, dds::ParticipantPtr participant);
  ~BesideBridges();

 private:
  BesideBridges(BridgeConfig config, std::vector<fabric::ClientConfig> ledgers,
                std::unique_ptr<crypto::MspRegistry> trusted, dds::ParticipantPtr participant);
  void carry();

  const BridgeConfig config_;
  const std::vector<fabric::ClientConfig> ledgers_;
  const std::unique_ptr<crypto::MspRegistry> trusted_;
  const dds::ParticipantPtr participant_;
  std::atomic<bool> quit_{false};
  std::thread thread_;
};

}  // namespace ledgerline::bridge
