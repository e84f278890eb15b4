#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/rt/clock.hpp"
#include "ledgerline.pb.h"
#include "tools/doctor/core/finding.hpp"

/// What is checked of a channel, its contract and the drones' records. Pure.
namespace ledgerline::doctor {

/// What agent.toml and ground.toml say of time.
struct TimeoutInputs {
  std::string program;
  std::optional<TimeNs> max_age_ns{}, silent_after_ns{};  ///< of agent alone
  TimeNs deadline_ns = 0;
  bool of_channel = false;  ///< [ledger] timeouts = "auto": they grow by themselves
};
Finding assess(const fabric::Batching& batching, const TimeoutInputs& facts);

/// The definition that is committed.
struct ContractFacts {
  std::string name;
  std::string refused{};  ///< the peer's words where there is none
  std::string version{}, own_version{};
  bool weak = false;  ///< one organisation alone satisfies its policy
};
Findings assess(const ContractFacts& facts);

enum class Side : std::uint8_t { agent, ground };
struct LeaseFacts {
  std::string drone;
  std::optional<Control> control{};  ///< none: it is not enrolled
  crypto::IdentityName self;
  Side side = Side::agent;
  bool is_operator = false;  ///< `self`, by the ledger's roles
};
Findings assess(const LeaseFacts& facts);

/// Of the newest block, and of one a moment later.
struct HeightFacts {
  std::string place;
  std::uint64_t height = 0, later = 0;
  std::optional<std::uint64_t> elsewhere{};  ///< of another organisation's peer
  std::optional<TimeNs> newest_age_ns{};     ///< by this host's clock, since its newest transaction was signed
};
Findings assess(const HeightFacts& facts);

/// Between `real_ns` and when the newest transaction of a serialized common.Block was signed, as its signer claims;
/// none: it cannot be read, or no transaction claims a time of our age.
std::optional<TimeNs> age_of_block(const std::string& block, TimeNs real_ns);

}  // namespace ledgerline::doctor
