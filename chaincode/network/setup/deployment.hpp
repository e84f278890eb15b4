#pragma once
#include <map>
#include <string>
#include <vector>

#include "chaincode/identities/first_calls.hpp"
#include "chaincode/network/setup/site.hpp"
#include "common/base/result.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::fabric_network {

/// Brings the contract onto a network whose peers have joined their channels: packages, the chaincode services, and
/// Fabric's lifecycle (install, approve, commit), each step once for a directory. `site` must outlive it. One thread, as
/// the site's.
class Deployment {
 public:
  explicit Deployment(Site& site) : site_(site) {}

  /// All, in this order, at every start of the network.
  Status make_packages();
  Status start_services();
  Status install();
  Status define();
  Status wait_for_contract();
  /// Until each own peer's gateway finds a majority to endorse, or, with a warning, until that has taken too long: the
  /// other hosts may be down.
  Status wait_for_endorsers();
  Status enroll_first();

 private:
  Status make_package(int organisation);
  Status approve(const std::string& channel, int organisation);
  Status commit(const std::string& channel);
  /// A command of Fabric's lifecycle on the contract's definition, sent to the first orderer.
  std::vector<std::string> lifecycle(const std::string& verb, const std::string& channel,
                                     const std::vector<std::string>& more = {}) const;
  Status enroll_first_on(const std::string& channel);
  Status call_until(fabric::Client& client, const FirstCall& call, TimeNs until);

  Site& site_;
  std::map<int, std::string> package_ids_;
};

}  // namespace ledgerline::fabric_network
