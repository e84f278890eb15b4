#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/fabric/tx/transaction.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/histogram.hpp"
#include "common/verification/control_events.hpp"

namespace ledgerline::audit {

// Lists that stay small however long a chain is. Each says what it has left out. One thread.

/// The first ones; of those behind them their number alone.
template <typename T>
class FirstOnes {
 public:
  explicit FirstOnes(std::size_t max) : max_(max) {}
  void add(T one) {
    if (all_.size() < max_) {
      all_.push_back(std::move(one));
    } else {
      ++left_out_;
    }
  }
  const std::vector<T>& all() const { return all_; }
  T* last() { return left_out_ > 0 || all_.empty() ? nullptr : &all_.back(); }
  /// Takes the last one out again.
  void drop_last() { all_.pop_back(); }
  std::uint64_t left_out() const { return left_out_; }
  std::uint64_t count() const { return all_.size() + left_out_; }

 private:
  std::size_t max_;
  std::vector<T> all_;
  std::uint64_t left_out_ = 0;
};

/// Every one at first, then every second, every fourth ...: from `max` / 2 to `max` of them, evenly over the whole.
template <typename T>
class Thinned {
 public:
  explicit Thinned(std::size_t max) : max_(max) {}
  void add(const T& one) {
    if (seen_++ % step_ != 0) return;
    all_.push_back(one);
    if (all_.size() < max_) return;
    for (std::size_t i = 0; 2 * i < all_.size(); ++i) all_[i] = all_[2 * i];
    all_.resize((all_.size() + 1) / 2);
    step_ *= 2;
  }
  const std::vector<T>& all() const { return all_; }
  std::uint64_t count() const { return seen_; }
  std::uint64_t step() const { return step_; }

 private:
  std::size_t max_;
  std::vector<T> all_;
  std::uint64_t seen_ = 0, step_ = 1;
};

/// How many when: a second each at first, and twice as long each time that there would be too many of them.
class OverTime {
 public:
  void add(TimeNs at_ns, bool good) {
    if (at_ns <= 0) return;  // a client that claims no time of our age
    auto& [valid, invalid] = counts_[at_ns / width_ns_];
    ++(good ? valid : invalid);
    while (counts_.size() > max_) widen();
  }
  TimeNs width_ns() const { return width_ns_; }
  /// Number of the interval since 1970 -> valid, invalid.
  const std::map<std::int64_t, std::pair<std::uint64_t, std::uint64_t>>& counts() const { return counts_; }

 private:
  static constexpr std::size_t max_ = 600;
  void widen() {
    width_ns_ *= 2;
    std::map<std::int64_t, std::pair<std::uint64_t, std::uint64_t>> wider;
    for (const auto& [at, both] : counts_) {
      wider[at / 2].first += both.first;
      wider[at / 2].second += both.second;
    }
    counts_ = std::move(wider);
  }
  TimeNs width_ns_ = ns_per_s;
  std::map<std::int64_t, std::pair<std::uint64_t, std::uint64_t>> counts_;
};

/// Where a transaction is, and the own verdict on it.
struct ValidationResult {
  std::uint64_t block = 0;
  std::size_t index = 0;
  int code = 0;          ///< protos.TxValidationCode
  const char* why = "";  ///< unless VALID
};

/// A moment on the chain. `time_ns` is what the transaction's creator claims: a ledger has no clock.
struct Moment {
  std::uint64_t block = 0;
  TimeNs time_ns = 0;
  std::string tx_id;
};

/// Who held a drone, from when to when.
struct Tenure {
  std::string who;
  std::uint64_t epoch = 0;
  std::uint32_t priority = 0;
  Moment from;
  std::optional<Moment> to;  ///< nullopt: still
  std::string ended_by;      ///< function and signer
  std::string delegate;      ///< who commanded in its place; empty: it did itself
};
/// What somebody said once: a stop, a clear_stop, a grant, a take-off, a landing, an alarm ...
struct Event {
  std::string what, who;
  Moment when;
  std::string object{};  ///< whom it is about: "to Org2MSP/User1: stop"; empty: the drone alone
};
struct Commands {
  std::uint64_t valid = 0;
  std::map<int, std::uint64_t> invalid;  ///< by code
  Moment first, last;
};
struct Change {
  Transition transition;
  Moment when;
};
struct PathPoint {
  TimeNs stamp_ns = 0;  ///< real time of the pose
  std::array<double, 3> position_m{};
};

/// What of a chain is reported, by the times that transactions' creators claim; all of it is checked.
struct TimeSpan {
  TimeNs from_ns = std::numeric_limits<TimeNs>::min(), to_ns = std::numeric_limits<TimeNs>::max();
  bool is_from_the_start() const { return from_ns == TimeSpan{}.from_ns; }
  bool is_to_the_end() const { return to_ns == TimeSpan{}.to_ns; }
  bool contains(TimeNs at_ns) const { return at_ns >= from_ns && at_ns <= to_ns; }
};

struct DroneReport {
  FirstOnes<Tenure> holders{1'000};
  FirstOnes<Event> events{2'000};
  std::map<std::string, Commands> commands;  ///< by who, of a delegate: "station under pilot's lease"
  OverTime commands_over_time;
  FirstOnes<Change> transitions{5'000};
  std::uint64_t transitions_missing = 0;  ///< gaps in the numbers that link gave them
  Thinned<PathPoint> path{4'000};
  std::array<double, 3> lowest_m{}, highest_m{};  ///< of all poses, by axis
  std::uint64_t states = 0;
  /// On the drone host's clock, as link signed it through its agent: from the stamp of a state until the command that
  /// answers it was with link. Of the commands that a later state names as the newest that had come.
  Histogram two_way;

  // To follow the chain with.
  bool is_in_span = true;  ///< the transaction that is read is in the span that is reported
  struct Alarmed {
    bool stands = false;
    std::uint64_t count = 0;
    bool operator==(const Alarmed&) const = default;
  };
  std::map<std::string, Alarmed> alarms;  ///< by kind, as reported last
  std::optional<Control> record;
  std::map<std::uint64_t, TimeNs> asked;  ///< sequence of a command -> stamp of the state that it answers
  std::uint64_t asked_epoch = 0, asked_boot = 0, last_arrived = 0, last_transition = 0, transition_boot = 0;
};

/// Invalid transactions of one signer, function and code.
struct Refusals {
  std::uint64_t count = 0;
  const char* why = "";
  Moment first;
};

/// What a channel shows of its drones: who held and commanded them, who stopped them, what their failsafes did, how
/// long a command took, where they flew. Everything is bounded or counted. Pure; one thread.
class ChainReport {
 public:
  explicit ChainReport(TimeSpan span = {}, std::string contract = "ledgerline")
      : span_(span), contract_(std::move(contract)) {}

  /// A transaction in the chain's order; `creator` as its certificate says. An error: what it wrote of a drone does not
  /// follow from what its creator signed and from the record before, though its endorsers let it pass.
  Status add(const ValidationResult& result, const fabric::Transaction& tx, const access::Caller& creator);

  static constexpr std::size_t max_drones = 1'000, max_refusals = 1'000, max_people = 1'000;
  struct RefusalKey {
    int code = 0;
    std::string who, function;
    auto operator<=>(const RefusalKey&) const = default;
  };
  const std::map<std::string, DroneReport>& drones() const { return drones_; }
  const std::map<RefusalKey, Refusals>& refusals() const { return refusals_; }
  std::uint64_t refusals_left_out() const { return refusals_left_out_; }
  /// Valid transactions by function; of other contracts by "CONTRACT:".
  const std::map<std::string, std::uint64_t>& functions() const { return functions_; }
  /// Roles given and taken.
  const FirstOnes<Event>& roles() const { return roles_; }
  /// Of missions' approvals, of files and the like: what their signers called them. Approvals of before that have not
  /// ended when the span begins are among them.
  const FirstOnes<Event>& anchors() const { return anchors_; }
  TimeNs first_ns() const { return first_ns_; }
  TimeNs last_ns() const { return last_ns_; }

 private:
  DroneReport* drone(const std::string& name);
  void add_refusal(const ValidationResult& result, const fabric::Transaction& tx, const std::string& who);
  void add_command(const ValidationResult& result, const fabric::Transaction& tx, const access::Caller& creator);
  void add_anchor(const fabric::Transaction& tx, const std::string& who, const Moment& when);
  void add_set(const fabric::Transaction& tx, const Moment& when);
  Status add_control(const fabric::Transaction& tx, const access::Caller& creator, const Moment& when);
  void add_record(const Control& after, const std::string& by, const Moment& when);

  TimeSpan span_;
  std::string contract_;
  bool is_in_span_ = true;
  std::map<std::string, DroneReport> drones_;
  std::map<RefusalKey, Refusals> refusals_;
  std::uint64_t refusals_left_out_ = 0;
  std::map<std::string, std::uint64_t> functions_;
  FirstOnes<Event> roles_{1'000}, anchors_{1'000};
  TimeNs first_ns_ = 0, last_ns_ = 0;
};

/// An identity as a person reads it: "Org2MSP/User1@org2.ledgerline".
std::string text_of(const crypto::IdentityName& name);

/// One asset of a drone, as its host's agent writes them: its pose, what link did, its failsafe's transitions. What is
/// malformed or of another type says nothing of the drone.
void add_asset(const Asset& asset, const Moment& when, DroneReport& report);

}  // namespace ledgerline::audit
