#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/setup/site.hpp"
#include "common/base/result.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::network {

/// Brings the contract onto a network whose peers have joined their channels: packages, the chaincode services, and
/// Fabric's lifecycle (install, approve, commit), each step once for a directory; a network that has the contract of an
/// older version gets a new definition, with the next sequence. `site` must outlive it. One thread, as the site's.
class Deployment {
 public:
  explicit Deployment(Site& site) : site_(site) {}

  /// All, in this order, at every start of the network.
  Status make_packages();
  Status start_services();
  Status install();
  Status define();
  /// Until each channel has this contract's definition: another host commits it.
  Status wait_for_definition();
  Status wait_for_contract();
  /// Until each own peer's gateway finds a majority to endorse, and each own organisation's peer (some calls need a
  /// certain one), or, with a warning, until that has taken too long: the other hosts may be down.
  Status wait_for_endorsers();
  Status enroll_first();

 private:
  Status make_package(int organisation);
  /// A definition of the contract, as Fabric has it.
  struct Definition {
    int sequence = 0;
    std::string version;
  };
  /// The one that counts on a channel, as this host's first peer knows it; it may be just starting.
  Result<Definition> definition_on(const std::string& channel);
  Status define_on(const std::string& channel);
  Status approve(const std::string& channel, int organisation, int sequence);
  Status commit(const std::string& channel, int sequence);
  /// A command of Fabric's lifecycle on the contract's definition, sent to the first orderer.
  std::vector<std::string> lifecycle(const std::string& verb, const std::string& channel, int sequence,
                                     const std::vector<std::string>& more = {}) const;
  Status enroll_first_on(const std::string& channel);
  /// Until the gateway of peer `k` finds the peer of organisation `other` to endorse, or a majority; at most until
  /// then.
  Status wait_for_endorser(fabric::Client& client, int k, std::optional<int> other, TimeNs until);
  Status call_until(fabric::Client& client, const FirstCall& call, TimeNs until);

  Site& site_;
  std::map<int, std::string> package_ids_;
};

}  // namespace ledgerline::network
