#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "common/rt/clock.hpp"
#include "hil/netem/impairment.hpp"

namespace ledgerline::hil {

/// The earlier of two moments, of which there may be none.
inline std::optional<TimeNs> earlier(std::optional<TimeNs> a, std::optional<TimeNs> b) {
  return a && b ? std::min(*a, *b) : a ? a : b;
}

/// What an emulated link did so far. Of datagrams: pushed + duplicated = delivered + lost + no_room + waiting.
struct EmulatedLinkCounts {
  std::uint64_t pushed = 0, delivered = 0;  ///< datagrams; of a stream: pieces
  std::uint64_t bytes_in = 0, bytes_out = 0;
  std::uint64_t lost = 0;     ///< by loss, a recorded link or partition
  std::uint64_t no_room = 0;  ///< dropped by the rate's queue or the link's own bounds
  std::uint64_t duplicated = 0, reordered = 0, corrupted = 0, truncated = 0;
};

/// One direction of a connection, impaired: what is pushed comes out of pop() when it is due. A core: no clock, no
/// socket; the same seed, impairments and pushes give the same bytes at the same times, and each effect has random
/// numbers of its own, so that one more effect does not change what the others draw. One thread; `now` never goes back.
///
/// Datagrams meet the effects in this order: partition, loss, the recorded link's losses, truncation, corruption; the
/// rate's queue; delay, and the recorded link's, which keep the order; jitter and reordering, which do not;
/// duplication. A stream keeps its bytes and their order. When the impairment changes, what is already on its way is
/// due when it was; only a stall holds it back, until the stall ends. A recorded link begins with the first call of
/// push() or pop() after it was set, and goes on while others change.
///
/// Bounded: beyond max_units or max_bytes on their way, a datagram that comes is dropped and counted, and a stream
/// takes no more (room()).
class EmulatedLink {
 public:
  enum class Kind { datagrams, stream };
  static constexpr std::size_t max_units = 4'096;
  static constexpr std::size_t max_bytes = 1'000'000;

  EmulatedLink(Kind kind, std::uint64_t seed);

  /// From now on. The error is check_for_stream()'s; then nothing is changed.
  Status set(const Impairment& impairment);
  const Impairment& impairment() const { return impairment_; }

  /// A datagram, which may be empty; or the next bytes of a stream, at most room(now) of them: none mean its end.
  /// `tag` comes out with it and means nothing to the link.
  void push(TimeNs now, std::string_view bytes, std::uint64_t tag = 0);
  /// How many bytes of a stream may be pushed now.
  std::size_t room(TimeNs now) const;

  struct Unit {
    std::string bytes;
    std::uint64_t tag = 0;
  };
  /// The next one that is due; call until there is none.
  std::optional<Unit> pop(TimeNs now);
  /// When pop() will give something; none: not before something is pushed or set.
  std::optional<TimeNs> next_due() const;

  std::size_t waiting() const { return units_.size(); }
  const EmulatedLinkCounts& counts() const { return counts_; }

 private:
  enum Effect { delay, jitter, loss, duplicate, reorder, corrupt, truncate, effects };
  bool draw_loss();
  bool draw(Effect effect, double of);
  void begin_recording(TimeNs now);
  /// What the recorded link does to what is pushed now; nothing without one.
  LinkRecording::Delivery recorded_delivery(TimeNs now) const;
  /// When it has passed the rate's queue; nothing: the queue is full.
  std::optional<TimeNs> pass_rate(TimeNs now, std::size_t bytes);
  double rate_backlog_bytes(TimeNs now) const;
  void push_datagram(TimeNs now, std::string bytes, std::uint64_t tag);
  void push_piece(TimeNs now, std::string_view bytes, std::uint64_t tag);
  void add_unit(TimeNs due, Unit unit);

  Kind kind_;
  Impairment impairment_;
  std::array<Random, effects> random_;                      // whether
  std::array<Draws, effects> draws_;                        // how long
  bool bad_ = false;                                        // of the loss model
  std::optional<TimeNs> recording_begins_;                  // of the recorded link, less its offset
  TimeNs rate_free_at_ = 0;                                 // when all that is in the rate's queue has passed
  TimeNs in_order_ = 0;                                     // nothing that keeps the order is due before this
  std::map<std::pair<TimeNs, std::uint64_t>, Unit> units_;  // by when they are due, then as they came
  std::uint64_t next_number_ = 0;
  std::size_t bytes_ = 0;
  EmulatedLinkCounts counts_;
};

}  // namespace ledgerline::hil
