#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

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
class Dialogue {
 public:
  explicit Dialogue(const std::vector<std::string>& questions, Timeouts timeout = {});

  /// What is to be sent now; empty: nothing.
  std::string pop_due(TimeNs now);
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

/// What is asked of a Tello that is found: neighbours in this order have answers of different shapes (Asking).
const std::vector<std::string>& questions_of_info();

struct Found {
  std::uint32_t address = 0;
  Dialogue dialogue;
};

/// A table, a line each; what a drone does not say is said so.
std::string words(const std::vector<Found>& drones);
/// {"drones":[{"address":"192.168.10.1","serial":"...","battery":87,"sdk":"20","hardware":"TELLO",
/// "wifi_version":"..."}]};
/// null: it does not say.
std::string json(const std::vector<Found>& drones);

/// IPv4 in host order: all hosts of "192.168.1.0/24" or a smaller subnet, without its own and its broadcast address
/// (but of /31 and /32). At most 254: a search for a drone sends nothing to networks beyond the user's room.
Result<std::vector<std::uint32_t>> hosts_of(const std::string& cidr);

/// Whether the word `ap`, which takes blanks for its ends, can have this network's name and password.
Status check_wifi(const std::string& ssid, const std::string& password);

/// Brings a Tello down, no matter who flew it: `command` until it is answered, a zero (it goes on with the last rc that
/// it got), and `land`, again each second until it is down. Down is what it says by `ok` to `land`, unless its state
/// text shows it aloft, or what its state text shows for a second. Answers carry no id: `command` and `land` both are
/// answered `ok`, so one more of them than `command`s were sent is the landing's. Core: no I/O, no clock; one thread.
class Landing {
 public:
  /// What is to be sent now, in this order.
  std::vector<std::string> pop_due(TimeNs now);
  void on_answer(std::string_view bytes);
  void on_state(TimeNs now, std::string_view bytes);

  bool down() const { return down_; }
  /// Anything came from it.
  bool has_answered() const { return oks_ > 0 || seen_; }
  /// For people: what it said last that is no `ok`.
  const std::string& refusal() const { return refusal_; }

 private:
  bool aloft(TimeNs now) const;

  bool started_ = false, down_ = false, seen_ = false;
  int commands_ = 0, oks_ = 0;
  TimeNs said_ns_ = 0, state_ns_ = 0, grounded_since_ns_ = 0;
  link::TelloState state_;
  std::string refusal_;
};

}  // namespace ledgerline::tello
