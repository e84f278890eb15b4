#pragma once
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "chaincode/endorser/core/endorser_core.hpp"
#include "chaincode/endorser/core/peer_follower.hpp"
#include "common/base/random.hpp"
#include "tests/unit/chaincode/endorser/channel.hpp"

namespace ledgerline::endorser {

/// The endorser's process without its threads: the core with its rules of readiness, fed by a stream that validates
/// whose blocks they are, as shell/service does. It may be killed, lag, lose its stream, and be shown what is no block
/// of the channel's.
class Machine {
 public:
  Machine(Channel& channel, Random& random) : channel_(channel), random_(random) {}

  void start(const Member& as);
  void kill() { core_.reset(); }
  bool runs() const { return core_ != nullptr; }
  bool failed() const { return runs() && readiness_.failed(); }
  const std::string& why() const { return why_; }
  std::uint64_t height() const { return core_->height(); }
  const Member* identity() const { return identity_; }

  /// The stream ends; it comes back with the next step that `connected` says so.
  void set_connected(bool connected) {
    if (runs() && connected != readiness_.connected()) readiness_.on_connection(connected);
  }
  /// The peer's blocks but for the newest `behind`, its height where that is asked for, and one check.
  void step(std::uint64_t behind, node::Now now);
  /// False: it was refused.
  bool show(const std::string& raw);
  node::Reply process_proposal(const std::string& signed_proposal, node::Now now);

 private:
  struct Check {
    std::string signed_proposal, answer;
    Readiness::DefinedAt defined_at{};
    int tried = 0;
  };
  void check(node::Now now);
  static constexpr int max_tries = 5;
  static constexpr std::uint64_t check_one_in = 10;
  static constexpr std::size_t max_checks = 16;

  Channel& channel_;
  Random& random_;
  const Member* identity_ = nullptr;
  std::unique_ptr<EndorserCore> core_;
  std::optional<fabric::BlockValidator> validator_;
  Readiness readiness_;
  std::string why_;
  std::deque<Check> checks_;
};

}  // namespace ledgerline::endorser
