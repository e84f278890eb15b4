#pragma once
#include <map>
#include <string>

#include "chaincode/contract/stub.hpp"
#include "chaincode/node/core/ledger/ledger.hpp"
#include "ledger/rwset/kvrwset/kv_rwset.pb.h"

namespace ledgerline::node {

/// How a range that was read is recorded.
enum class Ranges {
  as_wanted,  ///< with the keys that the contract got
  as_fabric,  ///< with those that a peer of Fabric reads for it
};

/// Runs a call against the committed state and records what it read and wrote.
class Simulation final : public chaincode::Stub {
 public:
  Simulation(const State& state, History& history, const crypto::MspRegistry::Member& caller,
             Ranges recorded_ranges = Ranges::as_wanted)
      : state_(state), history_(history), caller_(caller), recorded_ranges_(recorded_ranges) {}

  Result<std::optional<std::string>> get_state(const std::string& key) override;
  Status put_state(const std::string& key, const std::string& value) override;
  Status put_policy(const std::string& key, const std::string& msp_id) override;
  Result<std::vector<chaincode::KeyValue>> get_range(const std::string& start, const std::string& end,
                                                     std::size_t limit) override;
  Result<std::vector<chaincode::KeyVersion>> get_history(const std::string& key, std::size_t skip,
                                                         std::size_t limit) override;
  void set_event(const std::string& name, const std::string& payload) override;
  const crypto::IdentityName& caller() const override { return caller_.name; }
  bool caller_is_admin() const override { return caller_.admin; }

  /// Reads and writes in order of their keys, as Fabric writes them.
  kvrwset::KVRWSet read_write_set() const;
  /// By how many bytes what the caller's organisation has written would grow.
  std::int64_t growth_bytes() const;
  const std::string& event_name() const { return event_name_; }
  const std::string& event_payload() const { return event_payload_; }

 private:
  const State& state_;
  History& history_;
  const crypto::MspRegistry::Member& caller_;
  const Ranges recorded_ranges_;
  std::map<std::string, std::optional<Version>> reads_;
  std::map<std::string, std::string> writes_;
  std::map<std::string, std::string> policies_;  ///< common.SignaturePolicyEnvelope
  std::vector<kvrwset::RangeQueryInfo> ranges_;
  std::string event_name_, event_payload_;
};

}  // namespace ledgerline::node
