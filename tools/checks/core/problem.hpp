#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/base/result.hpp"

/// What can be wrong on a host and before a flight, with its cure: the one text for the lines of `ledgerline doctor`,
/// of `ledgerline tello preflight` and of `ledgerline fly`, and for docs/troubleshooting.md. Pure; any thread.
namespace ledgerline::checks {

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
  records_unread,
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
  clock_of_poses,
  // the drones' host
  no_real_time,
  no_locked_memory,
  shm_small,
  roudi_silent,
  roudi_left,
  roudi_foreign,
  roudi_runs,
  state_port_taken,
  port_unusable,
  interface_missing,
  interface_down,
  wrong_interface,
  drones_in_use,
  drone_silent,
  drone_other,
  state_silent,
  state_rare,
  battery_low,
  battery_short,
  battery_unknown,
  drone_hot,
  pose_silent,
  pose_old,
  pose_rare,
  pose_of_odometry,
  velocity_missing,
  velocity_no_reserve,
  position_uncertain,
  not_on_ground,
  takeoff_refused,
  // of all drones of a flight
  frames_differ,
  outside_fence,
  path_beyond_fence
};

enum class Severity : std::uint8_t { ok, warning, broken };
inline constexpr std::array severities{"ok", "warning", "broken"};
static_assert(severities.size() == enum_count<Severity>);

struct Description {
  Problem problem;
  const char* name;
  Severity severity;
  const char* cause;
  const char* cure;
};

/// In the order of the enum.
inline constexpr std::size_t problem_count = enum_count<Problem>;
const std::array<Description, problem_count>& all_problems();
inline const Description& describe(Problem problem) { return all_problems()[static_cast<std::size_t>(problem)]; }
/// The problem's own cure, with a value in each place of `placeholder`: "FILE", "NAME".
std::string cure_of(Problem problem, std::string_view placeholder, std::string_view value);

/// What one check has found: a line of the list.
struct Finding {
  std::string check;    ///< "identity"
  std::string drone{};  ///< whose it is; empty: of the host, or of all drones
  std::string what;     ///< of which file or place, and what was found
  std::optional<Problem> problem{};
  Severity severity = Severity::ok;  ///< the problem's own, unless who asks has another use for it
  std::string cure{};                ///< more exact than the problem's own; empty: that
};
using Findings = std::vector<Finding>;

Finding fine(std::string check, std::string what);
Finding found(Problem problem, std::string check, std::string what, std::string cure = {});
/// As before a take-off, which must wait for it.
Finding as_broken(Finding finding);
/// As of this drone.
Finding of_drone(std::string drone, Finding finding);
void add(Findings& all, Findings more);

/// Whether something is broken; warnings are not.
bool anything_broken(const Findings& findings);
/// A line each, a cure below what is not ok, and how many there were.
std::string words(const Findings& findings);
/// An error: what is broken, with its cures, as part of a sentence.
Status check(const Findings& findings);
/// {"ok":true,"checks":[{"check":"identity","drone":"tello1"|null,"verdict":"broken","problem":"key_open"|null,
/// "what":"...","cure":"..."|null}]}
std::string to_json(const Findings& findings);

/// What docs/troubleshooting.md has of these problems: a Markdown table.
std::string problems_table();

}  // namespace ledgerline::checks
