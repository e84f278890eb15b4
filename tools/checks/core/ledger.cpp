#include "tools/checks/core/ledger.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <bit>
#include <set>

#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "common/common.pb.h"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/channel_config.hpp"
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

Finding assess(const fabric::Batching& batching, const TimeoutInputs& inputs) {
  constexpr const char* check = "blocks";
  const TimeNs longer_ns = fabric::both_ways_ns(batching.timeout_ns, batching.max_messages);
  const deployment::Timeouts needed = deployment::timeout_with(longer_ns);
  const std::string what = fmt::format("{} transactions or {} a block", batching.max_messages, ms(batching.timeout_ns));
  std::string cure;
  const auto want = [&](const char* key, std::optional<TimeNs> is_ns, TimeNs needed_ns) {
    if (is_ns && *is_ns < needed_ns)
      cure += fmt::format("{}{} = {:.0f}", cure.empty() ? "" : ", ", key, to_ms(needed_ns));
  };
  if (longer_ns > 0 && !inputs.of_channel) {
    want("[check] max_age_ms", inputs.max_age_ns, needed.max_age_ns);
    want("[agent] ledger_silent_after_ms", inputs.silent_after_ns, needed.silent_after_ns);
    want("[ledger] deadline_ms", inputs.deadline_ns, needed.deadline_ns);
  }
  if (cure.empty()) return fine(check, fmt::format("{}, for which {} waits long enough", what, inputs.program));
  return flag(
      Problem::blocks_late, check, fmt::format("{}: {}", inputs.program, what),
      fmt::format("in {}: {}; or [ledger] timeouts = \"auto\"; or a shorter BatchTimeout", inputs.program, cure));
}

Finding assess_refusal(const std::string& words) {
  // The first that fits; "" is the problem's own cure. A peer does not say that a service has another package's id: it
  // waits for the right one, for minutes.
  constexpr std::array<std::pair<const char*, const char*>, 6> causes{{
      {"chaincode is not installed", "`ledgerline contract install` at this peer, of the package that is approved"},
      {"has not yet been approved by this org", "its administrator: `ledgerline contract approve`"},
      {"failed to create new connection: context deadline exceeded",
       "the certificate in CHAINCODE_TLS_CERT of `ledgerline-chaincode` must be of the package's --tls-root, and a "
       "firewall let `--address` through"},
      {"did not answer within",
       "`ledgerline contract status` waits longer, and tells a wrong CHAINCODE_ID of `ledgerline-chaincode` from a "
       "wrong certificate"},
      {"could not launch chaincode", ""},
      {"chaincode stream terminated", ""},
  }};
  for (const auto& [part, cure] : causes)
    if (words.find(part) != std::string::npos) return flag(Problem::contract_silent, "contract", words, cure);
  return flag(Problem::ledger_refuses, "ledger", words);
}

Findings assess(const ContractInputs& inputs) {
  constexpr const char* check = "contract";
  if (!inputs.refused.empty())
    return {flag(Problem::contract_missing, check, fmt::format("{}: {}", inputs.name, inputs.refused))};
  Findings out;
  if (inputs.version != inputs.own_version)
    out.push_back(flag(Problem::contract_other_version, check,
                       fmt::format("{}: {}, not {}", inputs.name, inputs.version, inputs.own_version)));
  if (inputs.weak) out.push_back(flag(Problem::policy_weak, check, inputs.name));
  if (out.empty()) out.push_back(fine(check, fmt::format("{}, version {}", inputs.name, inputs.version)));
  return out;
}

bool is_delegated(const LeaseInputs& inputs) {
  if (!inputs.control || !inputs.control->has_holder()) return false;
  const Identity self = identity_of(inputs.self);
  return same_identity(commander_of(*inputs.control), self) && !same_identity(inputs.control->holder(), self);
}

Findings assess(const LeaseInputs& inputs) {
  constexpr const char* check = "lease";
  const bool flies = inputs.side == Side::flight;
  const auto of = [&](Finding one) { return of_drone(inputs.drone, std::move(one)); };
  if (!inputs.control && flies && inputs.enrols) return {of(fine(check, "not enrolled yet: it is before the flight"))};
  if (!inputs.control)
    return {of(
        flag(Problem::not_enrolled, check, "no record of it", cure_of(Problem::not_enrolled, "NAME", inputs.drone)))};
  const Control& control = *inputs.control;
  const Identity self = identity_of(inputs.self);
  const bool is_ours = same_identity(commander_of(control), self);
  const auto held = [&](Problem problem, const std::string& what) {
    const Finding one = of(flag(problem, check, what, cure_of(problem, "NAME", inputs.drone)));
    return flies ? as_broken(one) : one;
  };
  Findings out;
  if (inputs.side == Side::agent && !same_identity(control.owner(), self))
    out.push_back(
        of(flag(Problem::of_another_host, check, fmt::format("to {}, not {}", name(control.owner()), name(self)))));
  if (inputs.side == Side::ground && (!inputs.is_operator || !rights_of(control, self).fly))
    out.push_back(
        of(flag(Problem::may_not_fly, check, name(self) + (inputs.is_operator ? " has no grant" : " is no operator"))));
  if (inputs.side != Side::agent && control.has_holder() && !is_ours)
    out.push_back(held(
        Problem::lease_held,
        fmt::format("held by {}, priority {}{}", name(control.holder()), control.priority(),
                    control.has_delegate() ? fmt::format(", who lets {} command it", name(control.delegate())) : "")));
  if (is_stopped(control)) out.push_back(held(Problem::stopped, "stopped by " + stopper_names(control)));
  if (!out.empty()) return out;
  if (!control.has_holder()) return {of(fine(check, flies ? "free: it is acquired before the flight" : "free"))};
  if (!is_ours || is_delegated(inputs))
    return {of(fine(check, (is_ours ? "ours to command: held by " : "held by ") + name(control.holder())))};
  return {of(fine(check, "ours"))};
}

Findings assess(const HeightInputs& inputs) {
  constexpr const char* check = "chain";
  Findings out;
  const bool moves = inputs.later > inputs.height;
  const std::string blocks = fmt::format("{}: {} blocks{}", inputs.place, inputs.later,
                                         moves ? ", and more come" : ", and none came meanwhile");
  if (inputs.elsewhere && *inputs.elsewhere > inputs.later + max_lag)
    out.push_back(flag(Problem::peer_lags, check, fmt::format("{}; another peer has {}", blocks, *inputs.elsewhere)));
  if (inputs.newest_age_ns && *inputs.newest_age_ns < -max_ahead_ns)
    out.push_back(flag(Problem::clock_behind, "clock",
                       fmt::format("by {} or more, by the newest block", ms(-*inputs.newest_age_ns))));
  if (inputs.newest_age_ns && moves && *inputs.newest_age_ns > max_behind_ns)
    out.push_back(flag(Problem::clock_ahead, "clock",
                       fmt::format("by {} or less, by the newest block", ms(*inputs.newest_age_ns))));
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

Finding assess(const ServerInputs& inputs) {
  constexpr const char* check = "server";
  using Reached = ServerInputs::Reached;
  const std::string what = fmt::format("{} of {}", inputs.endpoint, inputs.what);
  switch (inputs.reached) {
    case Reached::malformed:
      return flag(Problem::endpoint_wrong, check, what, cure_of_endpoint(inputs.endpoint));
    case Reached::name_unknown:
      return flag(Problem::name_unknown, check, fmt::format("{}: {}", what, inputs.why));
    case Reached::no_route:
      return flag(Problem::no_route, check, fmt::format("{}: {}", what, inputs.why));
    case Reached::silent:
      return flag(Problem::unreachable, check, what);
    case Reached::closed:
      return flag(Problem::port_closed, check, what);
    case Reached::yes:
      break;
  }
  if (!inputs.no_authority.empty())
    return flag(inputs.authority_problem, check, inputs.no_authority, inputs.authority_cure);
  if (!inputs.no_pair.empty()) return flag(Problem::tls_pair_wrong, check, fmt::format("{}: {}", what, inputs.no_pair));
  if (!inputs.refuses_certificate.empty())
    return flag(Problem::tls_pair_refused, check, fmt::format("{}: {}", what, inputs.refuses_certificate));
  if (!inputs.tls && inputs.wants_certificate) return flag(Problem::tls_client_certificate, check, what);
  if (!inputs.tls && inputs.mute) return flag(Problem::server_mute, check, what);
  if (!inputs.tls) return flag(Problem::no_tls, check, what);
  // By the authority first: of an outsider's certificate neither dates nor names mean anything.
  if (!inputs.trusted) {
    return flag(Problem::tls_wrong_authority, check,
                fmt::format("{}: it is of \"{}\", which {} does not have", what, inputs.issuer, inputs.tls_ca));
  }
  if (inputs.expired) return flag(Problem::tls_expired, check, what);
  if (inputs.not_yet) return flag(Problem::tls_not_yet, check, what);
  if (!inputs.right_name) {
    return flag(Problem::tls_wrong_name, check,
                fmt::format("{}: asked by \"{}\", it has {}", what, inputs.name, inputs.names));
  }
  if (inputs.wants_certificate) return flag(Problem::tls_client_certificate, check, what);
  if (!inputs.http2) return flag(Problem::no_tls, check, what);
  return fine(check, fmt::format("{}, as \"{}\"", what, inputs.name));
}

Finding assess_presence(ServerInputs inputs) {
  if (inputs.wants_certificate) inputs.tls = inputs.http2 = true;
  inputs.wants_certificate = false;
  inputs.trusted = inputs.right_name = true;
  return assess(inputs);
}

Findings assess_orderers(const std::vector<ServerInputs>& orderers) {
  Findings all;
  for (const ServerInputs& one : orderers) all.push_back(assess_presence(one));
  const bool any_serves = std::ranges::any_of(all, [](const Finding& one) { return !one.problem; });
  for (Finding& one : all) {
    if (!one.problem) continue;
    const bool is_down = one.problem == Problem::port_closed || one.problem == Problem::server_mute;
    if (any_serves || !is_down) one.severity = Severity::warning;
    one.cure = "start the orderer there; if it runs, only the peers need a way to it";
  }
  return all;
}

namespace {

// Of whose signatures each set is tried: 4,096 policies at most. For a channel with more that are missing all of
// them are reported.
constexpr std::size_t max_tried = 12;

using Names = std::vector<std::string>;

std::vector<fabric::PolicySigner> signers(const EndorsementInputs& inputs) {
  std::vector<fabric::PolicySigner> all;
  std::set<std::string> known;
  for (const EndorsingPeer& one : inputs.peers)
    if (one.why.empty() && known.insert(one.identity).second)
      all.push_back({.msp_id = one.msp_id, .peer = true, .identity = one.identity});
  return all;
}

bool would_do(const EndorsementInputs& inputs, std::vector<fabric::PolicySigner> signed_by, const Names& further) {
  for (const std::string& msp_id : further)
    signed_by.push_back({.msp_id = msp_id, .peer = true, .identity = "a peer of " + msp_id});
  return fabric::satisfies(inputs.policy, signed_by);
}

/// The smallest sets of further organisations whose signatures would do; empty: not even those of all.
std::vector<Names> missing_sets(const EndorsementInputs& inputs, const std::vector<fabric::PolicySigner>& signed_by) {
  Names absent;
  for (const std::string& msp_id : inputs.organisations)
    if (std::none_of(signed_by.begin(), signed_by.end(), [&](const auto& one) { return one.msp_id == msp_id; }))
      absent.push_back(msp_id);
  if (!would_do(inputs, signed_by, absent)) return {};
  if (absent.size() > max_tried) return {absent};
  std::vector<Names> found;
  for (std::size_t size = 1; size <= absent.size() && found.empty(); ++size) {
    for (unsigned chosen = 0; chosen < 1U << absent.size(); ++chosen) {
      if (static_cast<std::size_t>(std::popcount(chosen)) != size) continue;
      Names names;
      for (std::size_t i = 0; i < absent.size(); ++i)
        if ((chosen >> i & 1U) != 0) names.push_back(absent[i]);
      if (would_do(inputs, signed_by, names)) found.push_back(std::move(names));
    }
  }
  return found;
}

std::string words_of(const std::vector<Names>& sets) {
  Names texts;
  for (const Names& one : sets) texts.push_back(fmt::format("{}", fmt::join(one, " and ")));
  return fmt::format("{}", fmt::join(texts, " or "));
}

/// What brings this organisation's signature.
std::string cure_of(const EndorsementInputs& inputs, const std::string& msp_id) {
  for (const EndorsingPeer& one : inputs.peers) {
    if (one.said_to_be != msp_id) continue;
    if (one.msp_id != msp_id)
      return fmt::format("set endpoint and tls_ca of the [[endorser]] of {} in {} to those of a peer of {}", msp_id,
                         inputs.program, msp_id);
    if (!inputs.by_gateway)
      return fmt::format("start the peer of {}, {}, and the contract beside it", msp_id, one.place);
  }
  if (inputs.by_gateway)
    return fmt::format(
        "start a peer of {} that has joined the channel and has the contract, and that this peer hears of "
        "(anchor peers)",
        msp_id);
  return fmt::format("add an [[endorser]] of {} to {}", msp_id, inputs.program);
}

std::string who_signed_not(const EndorsementInputs& inputs) {
  std::string text;
  for (const EndorsingPeer& one : inputs.peers) {
    if (!one.why.empty())
      text += fmt::format("; {} of {}: {}", one.place, one.said_to_be, one.why);
    else if (one.msp_id != one.said_to_be)
      text += fmt::format("; {} of {} is a peer of {}", one.place, one.said_to_be, one.msp_id);
  }
  return text;
}

}  // namespace

Finding assess(const EndorsementInputs& inputs) {
  constexpr const char* check = "endorsement";
  const std::vector<fabric::PolicySigner> signed_by = signers(inputs);
  std::set<std::string> organisations;
  for (const fabric::PolicySigner& one : signed_by) organisations.insert(one.msp_id);
  const std::string signs = organisations.empty() ? "nobody" : fmt::format("{}", fmt::join(organisations, ", "));
  const std::string what = fmt::format("{}: {}: endorsed by {}", inputs.program, inputs.what, signs);
  if (fabric::satisfies(inputs.policy, signed_by)) return fine(check, what);
  const std::vector<Names> sets = missing_sets(inputs, signed_by);
  if (sets.empty())
    return flag(
        Problem::policy_unreachable, check,
        fmt::format("{}; a peer of each organisation of the channel would not do{}", what, who_signed_not(inputs)),
        "commit a definition with a policy that a peer of each of the channel's organisations can satisfy, such "
        "as a majority (docs/own-fabric.md)");
  std::set<std::string> reported;
  Names cures;
  for (const Names& names : sets)
    for (const std::string& msp_id : names)
      if (reported.insert(msp_id).second) cures.push_back(cure_of(inputs, msp_id));
  return flag(Problem::policy_unreachable, check,
              fmt::format("{}, and the signature of {} is missing{}", what, words_of(sets), who_signed_not(inputs)),
              fmt::format("{}", fmt::join(cures, sets.size() > 1 ? "; or " : "; and ")));
}

}  // namespace ledgerline::checks
