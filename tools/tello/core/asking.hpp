#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "common/rt/clock.hpp"

namespace ledgerline::tello {

/// How long an answer is waited for, and how often a question is asked at most.
struct Timeouts {
  TimeNs answer_ns = 500 * ns_per_ms;  ///< a Tello answers within tens of ms; double makes an empty room twice as slow
  int tries = 3;                       ///< with one datagram of five lost, 95 % get through
};

/// One question, and what came of it.
struct Question {
  std::string text;      ///< "battery?"
  std::string answer;    ///< printable and short; empty: none, or a refusal
  bool refused = false;  ///< its firmware does not know the question
};

/// Asks one Tello one question after the other, the first of them always `command`: a host that does not answer that is
/// no Tello. Answers carry no id, so one that cannot be to the question that is open (of another shape, as a late
/// answer to the one before) is dropped. Any bytes may come. Core: no I/O, no clock; one thread.
class Asking {
 public:
  explicit Asking(const std::vector<std::string>& questions, Timeouts timeout = {});

  /// What is to be sent now; empty: nothing.
  std::string due(TimeNs now);
  void on_answer(std::string_view bytes);

  bool over() const { return current_ >= questions_.size(); }
  /// It answered `command`.
  bool present() const { return present_; }
  const std::vector<Question>& questions() const { return questions_; }
  /// The answer to a question; empty: it does not say.
  std::string answer(std::string_view question) const;

 private:
  void next();

  std::vector<Question> questions_;
  Timeouts timeout_;
  std::size_t current_ = 0;
  int tries_ = 0;
  TimeNs asked_ns_ = 0;
  bool present_ = false;
};

/// Whether `text`, without its line's end, can be the answer to `question`.
bool fits(std::string_view question, std::string_view text);

}  // namespace ledgerline::tello
