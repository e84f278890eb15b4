#include "chaincode/network/setup/crypto_material.hpp"

#include <filesystem>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/files/authority.hpp"
#include "chaincode/network/files/places.hpp"
#include "chaincode/network/files/texts.hpp"
#include "common/base/file.hpp"

namespace ledgerline::fabric_network {
namespace {

Status issue_identities(Site& site, const identities::Hosts& hosts) {
  if (!site.options().ca) return identities::make(site.options().dir, site.options().orderers, hosts);
  const Authorities all = authorities(site.options(), site.places());
  if (Status s = prepare_authorities(all); !s) return s;
  if (Status s = check_free(site.places().authorities); !s) return s;
  for (int k = 0; k <= identities::organisations; ++k) {
    if (Status s = site.processes().start(authority_name(k), site.places().authority(k), authority_command(all),
                                          authority_environment(all, k));
        !s) {
      return s;
    }
  }
  const TimeNs until = monotonic_ns() + starting_limit_ns;
  for (int k = 0; k <= identities::organisations; ++k) {
    while (!authority_listens(all, k)) {
      if (Status s = site.processes().tend(10 * ns_per_ms); !s) return s;
      if (monotonic_ns() > until) return Error{authority_name(k) + " does not listen"};
    }
  }
  return identities::make(site.options().dir, site.options().orderers, hosts,
                          [&](const auto& wanted) { return issue_by_authorities(all, wanted); });
}

}  // namespace

Status make_crypto_material(Site& site) {
  if (site.options().several_hosts() && !std::filesystem::exists(site.in("crypto"))) {
    return Error{site.in("crypto") +
                 " is missing: the hosts of a network share its identities. Make them on one host with `ledgerline "
                 "fabric identities`, and bring each its own folder"};
  }
  identities::Hosts hosts;
  for (const ListenAddress& place : site.options().organisation_places) hosts.organisations.push_back(place.host);
  for (const ListenAddress& place : site.options().orderer_places) hosts.orderers.push_back(place.host);
  if (Status s = issue_identities(site, hosts); !s) return s;
  for (const char* name : {"detect", "build", "release"}) {
    if (Status s = write_file(site.in(std::string("builder/bin/") + name), builder_script(name), 0755); !s) return s;
  }
  return done;
}

}  // namespace ledgerline::fabric_network
