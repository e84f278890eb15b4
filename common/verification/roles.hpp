#pragma once
#include <map>
#include <set>
#include <string>

#include "common/verification/control_events.hpp"
#include "common/verification/control_records.hpp"

namespace ledgerline::verification {

/// MSP ids.
using Organisations = std::set<std::string>;

/// The organisations whose roles say something about these drones: their own, and those that they are granted to.
Organisations organisations_of(const std::vector<Control>& controls);

/// The roles that organisations have given to their people, as the ledger's records say at first and its events from
/// then on. Each organisation has its own bound, so that none takes another's place, nor makes this as large as it
/// likes. One thread.
class Roles {
 public:
  void take(const RoleChange& change);
  /// Its roles are here, if there are any.
  void follow(const std::string& msp_id) { organisations_[msp_id]; }
  /// Its events are taken from now on; what was before is being read, and comes with add().
  void await(const std::string& msp_id);
  /// Followed or awaited.
  bool follows(const std::string& msp_id) const { return organisations_.contains(msp_id); }
  Organisations followed() const;  ///< without those that are awaited
  /// What was read; where an event has said something since, that counts.
  void add(const Roles& read);
  /// Nothing of the organisation counts: its records are too many, or none that the contract writes.
  void leave_out(const std::string& msp_id);
  Role of(const crypto::IdentityName& who) const;
  std::map<crypto::IdentityName, Role> all() const;
  /// Organisations of which some or all roles were left out; for an alarm.
  const Organisations& left_out() const { return left_out_; }

 private:
  std::map<std::string, std::map<std::string, Role>> organisations_;  ///< by MSP id and subject
  Organisations awaited_, left_out_;
};

/// The ledger's roles of these organisations, which are followed then. An organisation whose records are too many or
/// damaged is left out, for its own account: the others' count. An error: the ledger does not answer.
Result<Roles> read_roles(const Evaluate& evaluate, const Organisations& organisations);

}  // namespace ledgerline::verification
