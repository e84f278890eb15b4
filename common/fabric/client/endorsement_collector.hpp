#pragma once
#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

/// Endorsements of one proposal, asked of the peers of several organisations side by side. Pure: who asks and who keeps
/// time is the caller.
namespace ledgerline::fabric {

class EndorsementCollector {
 public:
  /// Of one organisation's peer; the first that is not empty says what became of it.
  struct Answer {
    std::string organisation;
    std::string failure;   ///< not reached, or in no state to answer: why
    std::string refusal;   ///< the contract's no
    std::string result{};  ///< what it endorsed: equal ones make one transaction
    std::string bytes{};   ///< protos.ProposalResponse
  };
  enum class Next {
    wait,
    send,         ///< best() endorsed one result
    again,        ///< they do not agree: one may be a block behind
    refused,      ///< problem() has the contract's words
    unavailable,  ///< problem() says who did not answer
  };

  /// `asked`: the organisations. `enough`: how many must agree; `any`: one will do where no more are to be had.
  EndorsementCollector(std::vector<std::string> asked, std::size_t enough, bool any)
      : asked_(std::move(asked)), enough_(enough), any_(any) {}

  void add(Answer answer) { answers_.push_back(std::move(answer)); }

  /// `late`: who has not answered by now is not waited for.
  Next next(bool late) const {
    if (answers_.size() < asked_.size() && !late) return Next::wait;
    const std::size_t agreed = best().size();
    if (agreed >= enough_ || (agreed > 0 && any_)) return Next::send;
    const auto has = [&](std::string Answer::*what) {
      return std::any_of(answers_.begin(), answers_.end(), [&](const Answer& a) { return !(a.*what).empty(); });
    };
    const bool differ = std::count_if(answers_.begin(), answers_.end(), endorsed) > static_cast<long>(agreed);
    if (differ || (agreed > 0 && has(&Answer::refusal))) return Next::again;
    return agreed == 0 && has(&Answer::refusal) ? Next::refused : Next::unavailable;
  }

  /// The answers with the result that most have endorsed.
  std::vector<const Answer*> best() const {
    std::vector<const Answer*> best;
    for (const Answer& one : answers_) {
      if (!endorsed(one)) continue;
      std::vector<const Answer*> same;
      for (const Answer& other : answers_) {
        if (endorsed(other) && other.result == one.result) same.push_back(&other);
      }
      if (same.size() > best.size()) best = std::move(same);
    }
    return best;
  }

  /// Why there are not more: of a refusal the contract's words alone.
  std::string problem() const {
    std::string text;
    for (const Answer& one : answers_) {
      if (!one.refusal.empty() && best().empty()) return one.refusal;
      if (!one.failure.empty()) text += (text.empty() ? "" : "; ") + one.organisation + ": " + one.failure;
    }
    for (const std::string& organisation : asked_) {
      const bool answered = std::any_of(answers_.begin(), answers_.end(),
                                        [&](const Answer& one) { return one.organisation == organisation; });
      if (!answered) text += (text.empty() ? "" : "; ") + organisation + ": no answer in time";
    }
    return text;
  }

 private:
  static bool endorsed(const Answer& answer) { return answer.failure.empty() && answer.refusal.empty(); }

  std::vector<std::string> asked_;
  std::size_t enough_;
  bool any_;
  std::vector<Answer> answers_;
};

}  // namespace ledgerline::fabric
