#include "tools/checks/core/ledger.hpp"

#include <fmt/format.h>
#include <algorithm>

#include "common/common.pb.h"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/stops.hpp"
#include "tools/deployment/deployment.hpp"

namespace ledgerline::checks {

namespace {

// As agent accepts stamps of motion capture; and what a block takes on a slow ledger.
constexpr TimeNs max_ahead_ns = 20 * ns_per_ms, max_behind_ns = 5 * ns_per_s;
// Peers of one channel are a block or two apart.
constexpr std::uint64_t max_lag = 5;

std::string name(const Identity& who) { return who.msp_id() + " " + who.subject(); }

Identity identity_of(const crypto::IdentityName& who) {
  Identity identity;
  identity.set_msp_id(who.msp_id);
  identity.set_subject(who.subject);
  return identity;
}

std::string ms(TimeNs ns) { return fmt::format("{:.0f} ms", to_ms(ns)); }

}  // namespace

Finding assess(const fabric::Batching& batching, const TimeoutInputs& facts) {
  constexpr const char* check = "blocks";
  const TimeNs longer_ns = fabric::both_ways_ns(batching.timeout_ns, batching.max_messages);
  const deployment::Timeouts needed = deployment::timeout_with(longer_ns);
  const std::string what = fmt::format("{} transactions or {} a block", batching.max_messages, ms(batching.timeout_ns));
  std::string cure;
  const auto want = [&](const char* key, std::optional<TimeNs> is_ns, TimeNs needed_ns) {
    if (is_ns && *is_ns < needed_ns)
      cure += fmt::format("{}{} = {:.0f}", cure.empty() ? "" : ", ", key, to_ms(needed_ns));
  };
  if (longer_ns > 0 && !facts.of_channel) {
    want("[check] max_age_ms", facts.max_age_ns, needed.max_age_ns);
    want("[agent] ledger_silent_after_ms", facts.silent_after_ns, needed.silent_after_ns);
    want("[ledger] deadline_ms", facts.deadline_ns, needed.deadline_ns);
  }
  if (cure.empty()) return fine(check, fmt::format("{}, for which {} waits long enough", what, facts.program));
  return found(
      Problem::blocks_late, check, fmt::format("{}: {}", facts.program, what),
      fmt::format("in {}: {}; or [ledger] timeouts = \"auto\"; or a shorter BatchTimeout", facts.program, cure));
}

Findings assess(const ContractFacts& facts) {
  constexpr const char* check = "contract";
  if (!facts.refused.empty())
    return {found(Problem::contract_missing, check, fmt::format("{}: {}", facts.name, facts.refused))};
  Findings out;
  if (facts.version != facts.own_version)
    out.push_back(found(Problem::contract_other_version, check,
                        fmt::format("{}: {}, not {}", facts.name, facts.version, facts.own_version)));
  if (facts.weak) out.push_back(found(Problem::policy_weak, check, facts.name));
  if (out.empty()) out.push_back(fine(check, fmt::format("{}, version {}", facts.name, facts.version)));
  return out;
}

bool is_delegated(const LeaseFacts& facts) {
  if (!facts.control || !facts.control->has_holder()) return false;
  const Identity self = identity_of(facts.self);
  return same_identity(commander_of(*facts.control), self) && !same_identity(facts.control->holder(), self);
}

Findings assess(const LeaseFacts& facts) {
  constexpr const char* check = "lease";
  const bool flies = facts.side == Side::flight;
  const auto of = [&](Finding one) { return of_drone(facts.drone, std::move(one)); };
  if (!facts.control && flies && facts.enrols) return {of(fine(check, "not enrolled yet: it is before the flight"))};
  if (!facts.control)
    return {of(
        found(Problem::not_enrolled, check, "no record of it", cure_of(Problem::not_enrolled, "NAME", facts.drone)))};
  const Control& control = *facts.control;
  const Identity self = identity_of(facts.self);
  const bool is_ours = same_identity(commander_of(control), self);
  const auto held = [&](Problem problem, const std::string& what) {
    const Finding one = of(found(problem, check, what, cure_of(problem, "NAME", facts.drone)));
    return flies ? as_broken(one) : one;
  };
  Findings out;
  if (facts.side == Side::agent && !same_identity(control.owner(), self))
    out.push_back(
        of(found(Problem::of_another_host, check, fmt::format("to {}, not {}", name(control.owner()), name(self)))));
  if (facts.side == Side::ground && (!facts.is_operator || !rights_of(control, self).fly))
    out.push_back(
        of(found(Problem::may_not_fly, check, name(self) + (facts.is_operator ? " has no grant" : " is no operator"))));
  if (facts.side != Side::agent && control.has_holder() && !is_ours)
    out.push_back(held(
        Problem::lease_held,
        fmt::format("held by {}, priority {}{}", name(control.holder()), control.priority(),
                    control.has_delegate() ? fmt::format(", who lets {} command it", name(control.delegate())) : "")));
  if (is_stopped(control)) out.push_back(held(Problem::stopped, "stopped by " + stopper_names(control)));
  if (!out.empty()) return out;
  if (!control.has_holder()) return {of(fine(check, flies ? "free: it is acquired before the flight" : "free"))};
  if (!is_ours || is_delegated(facts))
    return {of(fine(check, (is_ours ? "ours to command: held by " : "held by ") + name(control.holder())))};
  return {of(fine(check, "ours"))};
}

Findings assess(const HeightFacts& facts) {
  constexpr const char* check = "chain";
  Findings out;
  const bool moves = facts.later > facts.height;
  const std::string blocks =
      fmt::format("{}: {} blocks{}", facts.place, facts.later, moves ? ", and more come" : ", and none came meanwhile");
  if (facts.elsewhere && *facts.elsewhere > facts.later + max_lag)
    out.push_back(found(Problem::peer_lags, check, fmt::format("{}; another peer has {}", blocks, *facts.elsewhere)));
  if (facts.newest_age_ns && *facts.newest_age_ns < -max_ahead_ns)
    out.push_back(found(Problem::clock_behind, "clock",
                        fmt::format("by {} or more, by the newest block", ms(-*facts.newest_age_ns))));
  if (facts.newest_age_ns && moves && *facts.newest_age_ns > max_behind_ns)
    out.push_back(found(Problem::clock_ahead, "clock",
                        fmt::format("by {} or less, by the newest block", ms(*facts.newest_age_ns))));
  if (out.empty()) out.push_back(fine(check, blocks));
  return out;
}

std::optional<TimeNs> age_of_block(const std::string& bytes, TimeNs real_ns) {
  common::Block block;
  if (!block.ParseFromString(bytes)) return std::nullopt;
  TimeNs newest_ns = 0;
  for (const std::string& transaction : block.data().data())
    newest_ns = std::max(newest_ns, fabric::time_of(fabric::read_form(transaction).channel_header.timestamp()));
  return newest_ns == 0 ? std::nullopt : std::optional(real_ns - newest_ns);
}

namespace {

/// Without a scheme and a path.
std::string bare(std::string endpoint) {
  if (const std::size_t scheme = endpoint.find("://"); scheme != std::string::npos) endpoint.erase(0, scheme + 3);
  return endpoint.substr(0, endpoint.find('/'));
}

std::string cure_of_endpoint(const std::string& endpoint) {
  const std::string host_and_port = bare(endpoint);
  if (is_endpoint(host_and_port)) return fmt::format("set it to \"{}\"", host_and_port);
  return fmt::format("add the port that the ledger prints: \"{}:PORT\"", host_and_port);
}

}  // namespace

bool is_endpoint(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos || colon == 0 || text.find('/') != std::string::npos) return false;
  const std::string port = text.substr(colon + 1);
  return !port.empty() && std::all_of(port.begin(), port.end(), [](char c) { return c >= '0' && c <= '9'; });
}

Finding assess(const ServerFacts& facts) {
  constexpr const char* check = "server";
  using Reached = ServerFacts::Reached;
  const std::string what = fmt::format("{} of {}", facts.endpoint, facts.what);
  switch (facts.reached) {
    case Reached::malformed:
      return found(Problem::endpoint_wrong, check, what, cure_of_endpoint(facts.endpoint));
    case Reached::name_unknown:
      return found(Problem::name_unknown, check, fmt::format("{}: {}", what, facts.why));
    case Reached::no_route:
      return found(Problem::no_route, check, fmt::format("{}: {}", what, facts.why));
    case Reached::silent:
      return found(Problem::unreachable, check, what);
    case Reached::closed:
      return found(Problem::port_closed, check, what);
    case Reached::yes:
      break;
  }
  if (!facts.no_authority.empty())
    return found(facts.authority_problem, check, facts.no_authority, facts.authority_cure);
  if (!facts.no_pair.empty()) return found(Problem::tls_pair_wrong, check, fmt::format("{}: {}", what, facts.no_pair));
  if (!facts.refuses_certificate.empty())
    return found(Problem::tls_pair_refused, check, fmt::format("{}: {}", what, facts.refuses_certificate));
  if (!facts.tls && facts.wants_certificate) return found(Problem::tls_client_certificate, check, what);
  if (!facts.tls && facts.mute) return found(Problem::server_mute, check, what);
  if (!facts.tls) return found(Problem::no_tls, check, what);
  // By the authority first: of an outsider's certificate neither dates nor names mean anything.
  if (!facts.trusted) {
    return found(Problem::tls_wrong_authority, check,
                 fmt::format("{}: it is of \"{}\", which {} does not have", what, facts.issuer, facts.tls_ca));
  }
  if (facts.expired) return found(Problem::tls_expired, check, what);
  if (facts.not_yet) return found(Problem::tls_not_yet, check, what);
  if (!facts.right_name) {
    return found(Problem::tls_wrong_name, check,
                 fmt::format("{}: asked by \"{}\", it has {}", what, facts.name, facts.names));
  }
  if (facts.wants_certificate) return found(Problem::tls_client_certificate, check, what);
  if (!facts.http2) return found(Problem::no_tls, check, what);
  return fine(check, fmt::format("{}, as \"{}\"", what, facts.name));
}

}  // namespace ledgerline::checks
