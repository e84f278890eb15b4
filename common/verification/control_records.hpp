#pragma once
#include <functional>
#include <map>
#include <set>
#include <stop_token>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/rt/retry.hpp"
#include "common/verification/control_events.hpp"
#include "ledgerline.pb.h"

/// The control records with which a program begins: who reads the ledger's blocks knows of changes alone.
namespace ledgerline::verification {

/// Asks the ledger without writing, as fabric::Client::evaluate.
using Evaluate = std::function<Result<std::string>(const fabric::Call&)>;

/// What `get` answers to an id, or to PREFIX/*, page by page; ends with the first error, of the ledger's or of `take`.
Status read_pages(const std::string& id, const Evaluate& evaluate, const std::function<Status(const Assets&)>& take);
/// Every record of a kind, page by page, as `get` answers to KIND/*; ends with the first error of `take`.
Status read_all(const std::string& kind, const Evaluate& evaluate, const std::function<Status(const Asset&)>& take);
/// The control record of a drone, by a call of the contract's `get`.
Result<Control> read_control(const std::string& drone, const Evaluate& evaluate);
/// Those of all these drones.
Result<std::vector<Control>> read_controls(const std::vector<std::string>& drones, const Evaluate& evaluate);
/// Reads until it succeeds, for max_controls_wait_ns at most; an error, too, when asked to stop. Says in the log why it
/// has not yet.
Status read_repeatedly(const std::stop_token& stop, const std::function<Status()>& read,
                       const TryWorld& world = TryWorld::real());
/// The same with read_controls().
Result<std::vector<Control>> read_controls_repeatedly(const std::stop_token& stop,
                                                      const std::vector<std::string>& drones, const Evaluate& evaluate,
                                                      const TryWorld& world = TryWorld::real());
/// The ledger has just sent a block, so it answers soon or something is broken. A minute outlasts a peer's restart; a
/// program that ends then is started again, where half of it would leave one that hears no block.
inline constexpr TimeNs max_controls_wait_ns = 60 * ns_per_s;

/// Puts the records and the blocks that change them in order. A stream that begins with the next new block says nothing
/// of what was committed just before it, and a peer may answer from before that. So the records are read again once the
/// first block is here: what that reading misses is in this block or a later one, which are held until then and
/// replayed over it. Pure; one thread.
class ControlStart {
 public:
  explicit ControlStart(std::size_t max_held = 1024) : max_held_(max_held) {}

  enum class Next {
    take,  ///< the block, now
    read,  ///< the records again; the block is held
    hold,  ///< on: the records are still being read
  };
  /// An error: more blocks came than can be held.
  Result<Next> on_block(const fabric::Block& block);
  /// The records were read again: take them, then these blocks in their order.
  std::vector<fabric::Block> on_read();
  /// For who goes on all the same when more blocks came than can be held: they are forgotten, so what is being read is
  /// of no use (is_useless()).
  void forget();
  bool is_useless() const { return forgotten_; }
  /// The records could not be read, or what was read is useless: the next block asks for them as the first one did.
  void restart();
  /// Of blocks that come each is taken at once.
  bool known() const { return known_; }

 private:
  const std::size_t max_held_;
  bool reading_ = false, known_ = false, forgotten_ = false;
  std::vector<fabric::Block> held_;
};

/// MSP ids.
using Organisations = std::set<std::string>;

/// The organisations whose roles say something about these drones: their own, and those that they are granted to.
Organisations organisations_of(const std::vector<Control>& controls);

/// The roles that organisations have given to their people, as the ledger's records say at first and its events from
/// then on. Each organisation has its own bound, so that none takes another's place, nor makes this as large as it
/// likes. One thread.
class RolesByOrganisation {
 public:
  void apply(const RoleChange& change);
  /// Its roles are here, if there are any.
  void follow(const std::string& msp_id) { organisations_[msp_id]; }
  /// Its events are taken from now on; what was before is being read, and comes with add().
  void await(const std::string& msp_id);
  /// Followed or awaited.
  bool follows(const std::string& msp_id) const { return organisations_.contains(msp_id); }
  Organisations followed() const;  ///< without those that are awaited
  /// What was read; where an event has said something since, that counts.
  void add(const RolesByOrganisation& read);
  /// Nothing of the organisation counts: its records are too many, or none that the contract writes.
  void exclude(const std::string& msp_id);
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
Result<RolesByOrganisation> read_roles(const Evaluate& evaluate, const Organisations& organisations);

}  // namespace ledgerline::verification
