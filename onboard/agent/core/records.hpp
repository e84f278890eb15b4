#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/verification/control_records.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::agent {

/// Who may do what with which drone, at one block of the chain: the blocks change it from then on.
struct FirstRecords {
  std::vector<Control> controls;
  verification::RolesByOrganisation roles;
};

/// For a checkpoint: Assets as the ledger's own `get` would answer, so that nothing new has to be read back.
std::string to_bytes(const FirstRecords& records);
/// An error: they are malformed, or one of the drones has no record among them.
Result<FirstRecords> records_from(std::string_view bytes, const std::vector<std::string>& drones);

/// Compares the records that agent trusts with those that a peer of another organisation reports. The two may be read
/// on either side of a block, so a difference counts once the very same two records differ in two comparisons in a row.
/// Pure; one thread.
class SecondOpinion {
 public:
  struct Difference {
    std::string what;          ///< the drone, or "roles"
    std::string ours, theirs;  ///< in short

    std::string text() const { return what + ": here " + ours + "; at another organisation's peer " + theirs; }
  };
  struct Comparison {
    std::vector<Difference> alarms;    ///< that have begun
    std::vector<std::string> cleared;  ///< of what alarms there is agreement again
    bool again_soon = false;           ///< something differs for the first time
  };
  Comparison compare(const FirstRecords& ours, const FirstRecords& theirs);
  /// What differs between the two, of whatever block each is.
  static std::vector<Difference> differences(const FirstRecords& ours, const FirstRecords& theirs);

  std::uint64_t alarms() const { return alarms_; }  ///< that have begun since the start
  bool differs() const;                             ///< an alarm stands
  std::uint64_t comparisons() const { return compared_; }

 private:
  struct ComparedRecord {
    std::string ours, theirs;  ///< bytes
    bool reported = false;
  };
  struct Pair {
    Difference in_short;
    ComparedRecord records;
  };
  static std::vector<Pair> pairs(const FirstRecords& ours, const FirstRecords& theirs);
  void compare(const Difference& in_short, ComparedRecord now, Comparison& comparison);

  std::map<std::string, ComparedRecord> different_;  ///< what differs, by its name
  std::uint64_t alarms_ = 0, compared_ = 0;
};

}  // namespace ledgerline::agent
