#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/calls/repeat.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/core/lease/lease_book.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {

/// Those who ask for a drone that we hold: each is reported to our operator once, and is answered by the config's rule
/// when the operator has not done so in time. For a drone that we command as delegate, its holder is notified and
/// answers. The rule hands over to the highest priority of those that are due. One answer of a drone at a time, again
/// over conflicts alone; a request whose answer fails is left to the operator. Deterministic; one thread.
class RequestAnswers {
 public:
  explicit RequestAnswers(const FlightConfig& config);

  /// `notes`: messages to our operator.
  void step(TimeNs now, const LeaseBook& leases, std::uint64_t& next_id, std::vector<Submission>& submissions,
            std::vector<std::string>& notes);
  struct Ended {
    std::size_t drone = 0;
    std::string problem;  ///< why the ledger will not have the answer; empty: it has, or it is given again
  };
  /// Nothing: the outcome is none of ours.
  std::optional<Ended> on_outcome(TimeNs now, const fabric::Outcome& outcome, std::uint64_t id);

 private:
  struct OpenRequest {
    Request request;
    TimeNs since_ns = 0;
    bool left = false;  ///< to the operator: an answer by the rule has failed
  };
  struct Slot {
    std::vector<OpenRequest> known{};
    std::optional<AnswerCall> answer{};      ///< to be submitted, or in flight
    std::optional<fabric::Repeat> repeat{};  ///< of that one
    std::uint64_t id = 0;                    ///< 0: not in flight
    TimeNs next_ns = 0;
  };
  void follow(TimeNs now, std::size_t drone, const Control* record, std::vector<std::string>& notes);
  void choose(TimeNs now, std::size_t drone);

  const FlightConfig& config_;
  std::uint64_t seed_;  ///< of the pauses' jitter
  std::vector<Slot> slots_;
};

}  // namespace ledgerline::ground
