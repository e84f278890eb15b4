#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "common/rt/clock.hpp"

/// The facts of the contract that both sides must know: its limits and the names of its functions. An event has the
/// name of the function that sets it.
namespace ledgerline::contract {

/// Beyond a limit a call is refused at endorsement with the limit named.
inline constexpr std::size_t max_id_chars = 128;
constexpr bool is_alphanumeric(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
}
constexpr bool is_id_char(char c) { return is_alphanumeric(c) || c == '_' || c == '.' || c == '/' || c == '-'; }

/// ROS 2's topics of a drone begin with its name, and a token of ROS 2 has no other form. The contract asks it of new
/// names alone: those that a ledger has already stay.
constexpr bool is_drone_name(std::string_view name) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  return !name.empty() && name.size() <= max_id_chars && name.front() != '_' && !is_digit(name.front()) &&
         std::ranges::all_of(name, [](char c) { return is_alphanumeric(c) || c == '_'; }) &&
         name.find("__") == std::string_view::npos;
}
/// What is said of a name that is none.
inline constexpr const char* drone_name_rule =
    "must be a letter, then letters, digits and single underscores, as ROS 2 has it for its topics";
inline constexpr std::size_t max_asset_bytes = 1'000'000;
inline constexpr std::size_t max_call_bytes = 1'000'000;
inline constexpr std::size_t max_call_assets = 1'000;
inline constexpr std::size_t max_batch_bytes = 32'000;
inline constexpr std::size_t max_drone_streams = 64;         ///< ids of one drone that stream
inline constexpr std::size_t max_organisation_drones = 256;  ///< names that an organisation enrolls
inline constexpr std::size_t max_subject_chars = 1'024;      ///< of an identity that a drone is granted to
inline constexpr std::size_t max_drone_grants = 64;   ///< identities and organisations that one drone is granted to
inline constexpr std::size_t digest_bytes = 32;       ///< SHA-256
inline constexpr std::size_t max_anchor_chars = 256;  ///< what its signer says of an anchor
inline constexpr std::size_t max_page_anchors = 64;   ///< that one verify answers, and signers that it is asked for
/// Maximum for one organisation in an answer about all of them: one that mints identities hides no other
/// organisation's.
inline constexpr std::size_t max_organisation_anchors = 16;
/// Identities of one organisation that ask for one drone at once.
inline constexpr std::size_t max_drone_requests = 16;
/// An organisation's roles are kept in so many records, by the first hex digit of the hash of each identity's name.
/// With one for all, a transaction that reads a role would lose to each enrolment in its organisation; one for each
/// identity has no bound.
inline constexpr std::size_t role_tables = 16;
/// Identities in one of them: 1,024 of an organisation, which a drone school reaches in decades (names outlive
/// certificates).
inline constexpr std::size_t max_table_roles = 64;
/// The same with those that are revoked without having had a role: a revocation finds a place where an enrolment does
/// not.
inline constexpr std::size_t max_table_entries = 128;
inline constexpr std::size_t max_organisation_roles = role_tables * max_table_entries;
/// Of one table, revocations included: 64 subjects of 250 characters, or 15 of 1,024. All of an organisation's are 512
/// kB.
inline constexpr std::size_t max_table_bytes = 32'000;
inline constexpr std::uint32_t max_priority = 999'999'999;  ///< of a lease
inline constexpr std::size_t max_page_versions = 64;        ///< old values of a key that one call looks at
inline constexpr std::size_t max_page_bytes = 1'000'000;
/// That one `get` looks at, deleted ones too: some 2 ms of a node's only thread. With ten times as many each asker
/// would delay a stop by more than its two-way takes; with a tenth a Fabric's 10,000 keys would need 200 calls.
inline constexpr std::size_t max_page_keys = 500;
inline constexpr TimeNs max_plan_ns = 2 * ns_per_s;
inline constexpr std::size_t max_plan_setpoints = 40;  ///< 2 s at 20 Hz

/// Of the records as this contract keeps them: 0 had no policies of keys, and leases of one holder for all
/// organisations.
inline constexpr std::uint32_t record_version = 1;
/// Of the definition on a channel: the next one where peers of this and the last one would not endorse the same.
inline constexpr const char* version = "4";

inline constexpr const char* set = "set";
inline constexpr const char* get = "get";
inline constexpr const char* history = "history";
inline constexpr const char* delete_ = "delete";
inline constexpr const char* enroll = "enroll";
inline constexpr const char* revoke = "revoke";
inline constexpr const char* grant = "grant";
inline constexpr const char* acquire = "acquire";
inline constexpr const char* release = "release";
inline constexpr const char* request = "request";
inline constexpr const char* hand_over = "hand_over";
inline constexpr const char* deny = "deny";
inline constexpr const char* evict = "evict";
inline constexpr const char* command = "command";
inline constexpr const char* stop = "stop";
inline constexpr const char* clear_stop = "clear_stop";
inline constexpr const char* apply_stops = "apply_stops";
inline constexpr const char* claim = "claim";
inline constexpr const char* unclaim = "unclaim";
inline constexpr const char* anchor = "anchor";
inline constexpr const char* verify = "verify";

/// Names that blocks written before still hold: of functions and their events, and of fields in JSON.
struct Renamed {
  std::string_view before, now;
};
inline constexpr std::array functions_before{Renamed{"fold", apply_stops}, Renamed{"resume", clear_stop}};
inline constexpr std::array fields_before{Renamed{"resumes", "clears"}, Renamed{"resumed", "cleared"},
                                          Renamed{"lifted", "cleared"}};
/// What a function of a block is called today.
constexpr std::string_view current_name(std::string_view function) {
  const auto found = std::ranges::find(functions_before, function, &Renamed::before);
  return found == functions_before.end() ? function : found->now;
}

/// The functions that write who may do what: roles, grants, leases, stops.
inline constexpr std::array<std::string_view, 12> control_functions{
    enroll, revoke, grant, acquire, release, request, hand_over, deny, evict, stop, clear_stop, apply_stops};
constexpr bool is_control(std::string_view function) {
  return std::ranges::find(control_functions, function) != control_functions.end();
}
/// The functions that claims let through.
constexpr bool is_claimed_for(std::string_view function) {
  return function == evict || function == grant || function == clear_stop || function == release;
}
/// The functions that write nothing.
constexpr bool is_question(std::string_view function) {
  return function == get || function == history || function == verify;
}
/// Control functions, the claims that let them through, and commands: what a full or busy ledger takes first.
constexpr bool is_urgent(std::string_view function) {
  return function == command || function == claim || function == unclaim || is_control(function);
}

/// Topics that ROS 2 and motion capture need for themselves: no drone has such a name.
inline constexpr std::array<std::string_view, 8> reserved_names{
    "clock", "diagnostics", "parameter_events", "robot_description", "rosout", "tf", "tf_static", "vrpn_mocap"};

}  // namespace ledgerline::contract
