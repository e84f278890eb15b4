#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "chaincode/network/processes/processes.hpp"
#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::network {

/// What an orderer's metrics say of its part in a channel's Raft.
struct RaftSign {
  bool leads = false;
  std::uint64_t stored = 0;  ///< how often it has written Raft's log: it grows with every message it answers
};
/// By channel, from the text of its /metrics.
std::map<std::string, RaftSign> raft_signs(const std::string& metrics);

/// Asks "127.0.0.1:PORT" for its metrics; waits a fifth of a second at most.
Result<std::string> fetch_metrics(const std::string& address);

/// Whether an orderer that was started takes part in Raft. One that reads its log again may hang for ever, and looks
/// alive from outside (issue 4199 of hyperledger/fabric, in 2.5.0): it answers its metrics, but neither leads nor
/// writes.
///
///     not_known -- leads, or has written twice, on each channel --> takes_part
///          \------ not so within `limit` of its first answer -----> hangs
class StartCheck {
 public:
  enum class Verdict { not_known, takes_part, hangs };
  StartCheck(std::vector<std::string> channels, TimeNs limit) : channels_(std::move(channels)), limit_(limit) {}
  Verdict update(TimeNs now, const std::map<std::string, RaftSign>& signs);

 private:
  std::vector<std::string> channels_;
  TimeNs limit_;
  std::optional<TimeNs> first_answer_;
  std::map<std::string, std::uint64_t> stored_first_;
};

/// Finds orderers that hang at a start of theirs (StartCheck), each time that one starts. One thread.
class OrdererWatch {
 public:
  static constexpr TimeNs between_ns = ns_per_s;     ///< two looks: a metrics page each
  static constexpr TimeNs limit_ns = 10 * ns_per_s;  ///< one takes part within two; it is ended after these

  /// `signs_of`: what an orderer's metrics say; empty while it does not answer.
  using SignsOf = std::function<std::map<std::string, RaftSign>(int orderer)>;
  OrdererWatch(std::vector<std::string> channels, SignsOf signs_of)
      : channels_(std::move(channels)), signs_of_(std::move(signs_of)) {}

  /// Names of those that hang, once for each start. Looks at most every `between_ns`.
  std::vector<std::string> update(TimeNs now, const std::vector<Processes::State>& states);

 private:
  struct Watched {
    pid_t pid = 0;
    std::optional<StartCheck> check;  ///< none: it takes part
  };
  const std::vector<std::string> channels_;
  const SignsOf signs_of_;
  std::map<std::string, Watched> watched_;  ///< since their last start
  TimeNs next_look_ = 0;
};

}  // namespace ledgerline::network
