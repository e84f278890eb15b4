#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"
#include "tools/init/core/host.hpp"

/// The config files of a host by its role. Pure.
namespace ledgerline::init {

/// admin: the identity that enrols drones and gives grants, from any host.
enum class Role : std::uint8_t { drone_host, ground, ledger, chaincode, bridge, admin };
inline constexpr std::array roles{"drone-host", "ground", "ledger", "chaincode", "bridge", "admin"};
static_assert(roles.size() == enum_count<Role>);
Role role_of(std::string_view name);  ///< a name of the array

struct File {
  std::string name;  ///< within the config folder
  std::string text;
};

/// An error: the role has nothing to do on that host, such as flying none of the drones.
Result<std::vector<File>> files_of(Role role, const HostPlan& plan);

/// A deployment.toml to begin with: three hosts, two drones, and every key in the reference's words.
Result<std::string> example_deployment();

}  // namespace ledgerline::init
