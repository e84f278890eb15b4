#pragma once
#include <array>
#include <cstdint>
#include <string_view>

#include "common/base/enum_count.hpp"

/// What doctor can find, with its cure: the one text for its lines and for docs/troubleshooting.md. Pure.
namespace ledgerline::doctor {

enum class Problem : std::uint8_t {
  // files
  config_missing,
  config_wrong,
  file_forbidden,
  not_pem,
  drones_differ,
  state_folder,
  disk_read_only,
  disk_full,
  disk_low,
  // the identity
  certificate_missing,
  certificate_wrong,
  certificate_order,
  key_missing,
  key_open,
  key_locked,
  key_misfit,
  identity_expired,
  identity_not_yet,
  identity_ends,
  identity_foreign,
  // whom to trust
  anchor_missing,
  anchor_wrong,
  authority_unreadable,
  authority_foreign,
  organisation_missing,
  // the way to the ledger
  endpoint_wrong,
  name_unknown,
  no_route,
  unreachable,
  port_closed,
  server_mute,
  no_tls,
  tls_ca_unreadable,
  tls_wrong_authority,
  tls_wrong_name,
  tls_expired,
  tls_not_yet,
  tls_client_certificate,
  tls_pair_wrong,
  tls_pair_refused,
  // the ledger
  ledger_refuses,
  peer_lags,
  contract_missing,
  contract_other_version,
  policy_weak,
  policy_unreachable,
  blocks_late,
  // the drones on it
  not_enrolled,
  of_another_host,
  may_not_fly,
  lease_held,
  stopped,
  // clocks
  clock_unsynchronised,
  clock_behind,
  clock_ahead,
  // the drones' host
  no_real_time,
  no_locked_memory,
  shm_small,
  roudi_silent,
  roudi_left,
  roudi_foreign,
  state_port_taken,
  interface_missing,
  interface_down,
  wrong_interface,
  drones_in_use,
  drone_silent,
  state_silent,
  battery_low,
  pose_silent
};

enum class Verdict : std::uint8_t { ok, warning, broken };
inline constexpr std::array verdicts{"ok", "warning", "broken"};
static_assert(verdicts.size() == enum_count<Verdict>);

struct Words {
  Problem problem;
  const char* name;
  Verdict verdict;
  const char* cause;
  const char* cure;
};

/// In the order of the enum.
inline constexpr std::size_t problem_count = enum_count<Problem>;
const std::array<Words, problem_count>& all_problems();
inline const Words& words_of(Problem problem) { return all_problems()[static_cast<std::size_t>(problem)]; }

}  // namespace ledgerline::doctor
