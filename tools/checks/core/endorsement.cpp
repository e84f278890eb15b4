#include "tools/checks/core/ledger.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <set>

namespace ledgerline::checks {
namespace {

// Of whose signatures each set is tried: 4,096 policies at most. For a channel with more that are missing all of
// them are reported.
constexpr std::size_t max_tried = 12;

using Names = std::vector<std::string>;

std::vector<fabric::Endorser> signers(const EndorsementInputs& inputs) {
  std::vector<fabric::Endorser> all;
  std::set<std::string> known;
  for (const EndorsingPeer& one : inputs.peers)
    if (one.why.empty() && known.insert(one.identity).second)
      all.push_back({.msp_id = one.msp_id, .peer = true, .identity = one.identity});
  return all;
}

bool would_do(const EndorsementInputs& inputs, std::vector<fabric::Endorser> signed_by, const Names& further) {
  for (const std::string& msp_id : further)
    signed_by.push_back({.msp_id = msp_id, .peer = true, .identity = "a peer of " + msp_id});
  return fabric::satisfies(inputs.policy, signed_by);
}

/// The smallest sets of further organisations whose signatures would do; empty: not even those of all.
std::vector<Names> missing_sets(const EndorsementInputs& inputs, const std::vector<fabric::Endorser>& signed_by) {
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
  const std::vector<fabric::Endorser> signed_by = signers(inputs);
  std::set<std::string> organisations;
  for (const fabric::Endorser& one : signed_by) organisations.insert(one.msp_id);
  const std::string signs = organisations.empty() ? "nobody" : fmt::format("{}", fmt::join(organisations, ", "));
  const std::string what = fmt::format("{}: {}: endorsed by {}", inputs.program, inputs.what, signs);
  if (fabric::satisfies(inputs.policy, signed_by)) return fine(check, what);
  const std::vector<Names> sets = missing_sets(inputs, signed_by);
  if (sets.empty())
    return flag(
        Problem::policy_unreachable, check,
        fmt::format("{}; a peer of each organisation of the channel would not do{}", what, who_signed_not(inputs)),
        "commit a definition with a policy that a peer of each of the channel's organisations can satisfy, such "
        "as a majority (docs/fabric.md)");
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
