#pragma once
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "chaincode/network/processes/processes.hpp"
#include "chaincode/network/processes/start_check.hpp"

namespace ledgerline::fabric_network {

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

}  // namespace ledgerline::fabric_network
