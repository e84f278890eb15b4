#pragma once
#include "chaincode/network/setup/site.hpp"
#include "common/base/result.hpp"

namespace ledgerline::fabric_network {

/// Identities of all members, made here or by fabric-ca's servers, which are then among the site's processes; and the
/// scripts with which peers build chaincode packages. What the directory has stays.
Status make_crypto_material(Site& site);

}  // namespace ledgerline::fabric_network
