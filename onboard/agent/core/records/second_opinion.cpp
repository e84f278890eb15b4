#include "onboard/agent/core/records/second_opinion.hpp"

#include <algorithm>
#include <utility>

namespace ledgerline::agent {
namespace {

// Who of those that a record names is revoked follows from the roles, which are compared themselves.
std::string bytes_of(Control record) {
  record.clear_revoked();
  return record.SerializeAsString();
}

std::string text_of(const Identity& who) { return who.msp_id() + " " + who.subject(); }

std::string in_short(const Control& record) {
  return (record.has_holder() ? "held by " + text_of(record.holder()) : "not held") +
         (record.has_delegate() ? ", commanded by " + text_of(record.delegate()) : "") + ", epoch " +
         std::to_string(record.epoch()) + ", " + std::to_string(record.stoppers_size()) + " stops, " +
         std::to_string(record.grants_size()) + " grants";
}

// An identity without a role and one that is not known may do the same. Of organisations that one of the two does not
// follow, or has left out, nothing is compared.
std::map<crypto::IdentityName, Role> given(const verification::Roles& roles, const verification::Roles& others) {
  std::map<crypto::IdentityName, Role> out = roles.all();
  const auto followed = roles.followed(), followed_there = others.followed();
  std::erase_if(out, [&](const auto& one) {
    const std::string& msp_id = one.first.msp_id;
    return one.second == ROLE_NONE || !followed.contains(msp_id) || !followed_there.contains(msp_id) ||
           roles.left_out().contains(msp_id) || others.left_out().contains(msp_id);
  });
  return out;
}

std::string text_of(const std::map<crypto::IdentityName, Role>& roles) {
  std::string text;
  for (const auto& [who, role] : roles) text += who.msp_id + " " + who.subject + " " + Role_Name(role) + "\n";
  return text;
}

}  // namespace

void SecondOpinion::compare(const Difference& in_short, ComparedRecord now, Verdict& verdict) {
  const auto known = seen_.find(in_short.what);
  if (now.ours == now.theirs) {
    if (known == seen_.end()) return;
    if (known->second.reported) verdict.cleared.push_back(in_short.what);
    seen_.erase(known);
    return;
  }
  if (known == seen_.end()) {
    seen_.emplace(in_short.what, std::move(now));
    verdict.again_soon = true;
    return;
  }
  ComparedRecord& before = known->second;
  if (before.reported) return;
  if (before.ours == now.ours && before.theirs == now.theirs) {
    before.reported = true;
    ++alarms_;
    verdict.alarms.push_back(in_short);
    return;
  }
  before = std::move(now);
  verdict.again_soon = true;
}

std::vector<SecondOpinion::Pair> SecondOpinion::pairs(const FirstRecords& ours, const FirstRecords& theirs) {
  std::vector<Pair> pairs;
  for (const Control& control : ours.controls) {
    const auto reported = std::find_if(theirs.controls.begin(), theirs.controls.end(),
                                       [&](const Control& one) { return one.drone() == control.drone(); });
    const bool there = reported != theirs.controls.end();
    pairs.push_back({{control.drone(), in_short(control), there ? in_short(*reported) : "no record"},
                     {bytes_of(control), there ? bytes_of(*reported) : ""}});
  }
  const auto our_roles = given(ours.roles, theirs.roles), their_roles = given(theirs.roles, ours.roles);
  pairs.push_back(
      {{"roles", std::to_string(our_roles.size()) + " of them", std::to_string(their_roles.size()) + " of them"},
       {text_of(our_roles), text_of(their_roles)}});
  return pairs;
}

SecondOpinion::Verdict SecondOpinion::compare(const FirstRecords& ours, const FirstRecords& theirs) {
  ++compared_;
  Verdict verdict;
  for (Pair& pair : pairs(ours, theirs)) compare(pair.in_short, std::move(pair.seen), verdict);
  return verdict;
}

std::vector<SecondOpinion::Difference> SecondOpinion::differences(const FirstRecords& ours,
                                                                  const FirstRecords& theirs) {
  std::vector<Difference> different;
  for (Pair& pair : pairs(ours, theirs)) {
    if (pair.seen.ours != pair.seen.theirs) different.push_back(std::move(pair.in_short));
  }
  return different;
}

bool SecondOpinion::differs() const {
  return std::any_of(seen_.begin(), seen_.end(), [](const auto& one) { return one.second.reported; });
}

}  // namespace ledgerline::agent
