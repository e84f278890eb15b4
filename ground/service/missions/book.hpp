#pragma once
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "ground/mission/check.hpp"
#include "ground/mission/run.hpp"
#include "ground/service/core/api.hpp"

namespace ledgerline::ground::service {

/// [mission] of ground.toml.
struct MissionSettings {
  std::string folder;  ///< where missions are kept; empty: nowhere, so a ground that is started again knows none
  mission::RunConfig run{};
  mission::CheckConfig check{};
  std::vector<std::string> approvers;  ///< MSP ids whose members' approvals count; empty: our own
  std::int64_t approval_s = 86'400;    ///< so old an approval is at most
};

/// The station's missions: added, checked, approved, flown by a MissionRun each, and kept. No I/O; the flight's thread.
class MissionBook {
 public:
  static constexpr std::size_t max_missions = 16;

  /// `self`: who signs where no operator does.
  MissionBook(MissionSettings settings, crypto::IdentityName self);

  /// The error, or the id of the new mission: the first digits of its hash. `by`: whose it is, as below.
  Result<std::string> add(mission::MissionRun run, std::optional<crypto::IdentityName> by = {});
  /// What saved() gave. The error: it is none.
  Result<std::string> restore(std::string_view text);
  // `by`: who asks; none: ground's own identity, where no operators sign in. A mission is its owner's: who added or
  // started it. Whatever is asked of it is asked by him, but for the landing, which anybody may ask.

  /// Of one that is not flown, and of which no drone has yet to land.
  Status remove(const std::string& id, const std::optional<crypto::IdentityName>& by);
  /// Somebody is no operator any more: what he owns and does not fly is the next one's who asks.
  void disown(const crypto::IdentityName& owner);
  /// As read from the ledger: who approves it.
  void set_signers(const std::string& id, const std::vector<crypto::IdentityName>& signers);
  /// What check() found.
  void set_findings(const std::string& id, std::vector<mission::Finding> findings);

  /// What check() said of a mission, and of which moment.
  struct Checked {
    std::vector<mission::Finding> findings{};
    std::vector<mission::DroneNow> then{};
  };
  /// The operator who starts it must hold all of its drones. No other mission may fly one of them, and each must still
  /// be where it was checked.
  Status start(const std::string& id, const std::optional<crypto::IdentityName>& by, const Checked& checked,
               const FlightView& flights);
  Status pause(const std::string& id, const std::optional<crypto::IdentityName>& by);
  /// Its owner must still hold the drones that are left. `checked`: rest().
  Status resume(const std::string& id, const std::optional<crypto::IdentityName>& by, const Checked& checked,
                const FlightView& flights);
  Status land(const std::string& id, const std::string& why);
  /// One of Outputs::awaiting_check; `checked`: rest(). It goes on as resume() would have it, or hovers and says why.
  void resume_after_check(const std::string& id, const Checked& checked, const FlightView& flights);

  struct Outputs {
    std::vector<PilotCommand> commands;
    std::vector<mission::RunEvent> events;
    std::vector<std::string> kept;            ///< ids of those whose saved() changed since the last step
    std::vector<std::string> ended;           ///< ids of those that are done or aborted by now
    std::vector<std::string> awaiting_check;  ///< ids of those that a restart has found in the air, once each
  };
  /// Behind FlightCore's step.
  Outputs step(TimeNs now, const FlightView& flights);
  /// Whether step() has anything to do.
  bool busy() const;

  bool has(const std::string& id) const { return missions_.contains(id); }
  const mission::Mission& mission(const std::string& id) const { return missions_.at(id).run->mission(); }
  mission::Mission rest(const std::string& id) const { return missions_.at(id).run->rest(); }
  const crypto::Digest& digest(const std::string& id) const { return missions_.at(id).run->digest(); }
  const mission::CheckConfig& check_config() const { return settings_.check; }
  std::vector<std::string> ids() const;

  /// JSON of docs/station.md.
  std::string list() const;
  std::string show(const std::string& id) const;
  /// For restore().
  std::string saved(const std::string& id) const;
  /// What became of it, for the ledger's eyes: a JSON text whose hash is anchored. `realtime_s`: now.
  std::string record(const std::string& id, std::int64_t realtime_s) const;
  /// Whether it has changed since this was asked last.
  bool pop_changed() { return std::exchange(changed_, false); }

 private:
  struct Entry {
    std::unique_ptr<mission::MissionRun> run;
    std::string paths;  ///< JSON, of show()
    std::optional<crypto::IdentityName> by{};
    std::vector<crypto::IdentityName> signers{};
    std::vector<mission::Finding> findings{};
    bool check_requested = false;
    bool stirred = false;  ///< step() has something to report of it
    mission::RunPhase phase = mission::RunPhase::checked;
  };
  Entry* find(const std::string& id);
  /// Applies a request to one mission; on success the next step() reports it, and pop_changed() has it listed again.
  template <typename Say>
  Status apply_request(const std::string& id, const Say& say);
  const crypto::IdentityName& whose(const std::optional<crypto::IdentityName>& by) const { return by ? *by : self_; }
  /// The one rule of whose a mission is.
  Status may(const std::optional<crypto::IdentityName>& by, const Entry& entry) const;
  /// What speaks against flying these drones of it now.
  Status may_fly(const Entry& entry, const mission::Mission& part, const std::optional<crypto::IdentityName>& by,
                 const Checked& checked, const FlightView& flights) const;
  std::vector<mission::DroneNow> drones_for(const Entry& entry, std::vector<mission::DroneNow> drones,
                                            const FlightView& flights) const;
  nlohmann::json json_of(const std::string& id, const Entry& entry) const;

  MissionSettings settings_;
  const crypto::IdentityName self_;
  std::map<std::string, Entry> missions_;  ///< by id
  bool changed_ = true;
};

}  // namespace ledgerline::ground::service
