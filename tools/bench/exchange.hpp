#pragma once
#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

/// A two-way exchange: side a sends messages, side b answers each, and a sees the answers. What both sides must agree
/// on, and a's account of it. No I/O.
namespace ledgerline::bench {

/// When which message is sent. Warm-up goes at 70 msg/s at least, since what compiles itself as it runs warms up by
/// calls and not by seconds; its last part goes at the rate itself. Message n belongs to stream n modulo `streams`: a
/// stream is a drone of at most 35 Hz.
struct Schedule {
  int streams = 1;
  double fast_per_s = 0;  ///< of a alone, as is per_s
  std::uint64_t fast_count = 0;
  double per_s = 0;
  std::uint64_t first = 0, count = 0;  ///< those that are measured
  double drain_s = 0;  ///< how long answers are awaited; messages go on meanwhile, so that the load stays the same

  TimeNs due_ns(std::uint64_t n) const;  ///< after the start
  /// The maximum time that side a takes.
  double length_s() const;
};
/// `rate`: messages a second of both directions together.
Schedule make_schedule(int rate, double warm_up_s, double seconds, double drain_s);
/// As JSON, for the clients' command line.
std::string write_schedule(const Schedule& schedule);
Result<Schedule> read_schedule(const std::string& text);

/// What became of a's messages. Those measured end in one of three ways:
///
///     sent -> answered
///          -> replaced   a newer one of its stream was answered before it, where a ledger client merges or reads the
///                        newest value alone (`in_order`); its time is until that answer
///          -> lost       none of both when the run ended; its time is until then
class Account {
 public:
  Account(const Schedule& schedule, bool in_order)
      : schedule_(schedule), in_order_(in_order), open_(schedule.streams) {}

  /// Message n, the next one in order, is made now.
  void sent(TimeNs now, std::uint64_t n);
  /// An answer to n, whose stamp came back with it. False: nobody asked, or it was answered already.
  bool answered(TimeNs now, std::uint64_t n, TimeNs stamp);
  /// The measured time is over, and all of its messages have ended.
  bool complete() const { return past_ && open_measured_ == 0; }
  /// Nothing comes any more: what is open is lost.
  void end(TimeNs now);

  std::uint64_t sent() const { return sent_; }
  std::uint64_t answered() const { return answered_; }
  std::uint64_t replaced() const { return replaced_; }
  std::uint64_t answers() const { return answers_; }  ///< to all messages, warm-up and drain too
  /// Of every measured message that has ended.
  const std::vector<TimeNs>& times() const { return times_; }

 private:
  struct Open {
    std::uint64_t n;
    TimeNs at;
    bool operator<(const Open& other) const { return n < other.n; }
  };
  bool measured(std::uint64_t n) const { return n >= schedule_.first && n < schedule_.first + schedule_.count; }
  void close(TimeNs now, const Open& open);

  Schedule schedule_;
  bool in_order_;
  bool past_ = false;                 // the first message behind those measured was sent
  std::vector<std::set<Open>> open_;  // by stream
  std::uint64_t sent_ = 0, answered_ = 0, replaced_ = 0, answers_ = 0, open_measured_ = 0;
  std::vector<TimeNs> times_;
};

/// The message itself: an odometry in the published layout, about 500 bytes.
struct Message {
  std::uint64_t n = 0;
  TimeNs stamp_ns = 0;  ///< a's CLOCK_MONOTONIC
};
std::string write_message(const Message& message, const std::string& topic);
/// False: it is none.
bool read_message(const std::string& text, Message& message);

}  // namespace ledgerline::bench
