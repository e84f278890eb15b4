#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/contract.hpp"
#include "common/rt/clock.hpp"

/// ROS 2 topics of any type, as bytes: no type is compiled in. A message is its CDR with the four bytes of
/// encapsulation header, little or big endian (PLAIN_CDR, what ROS 2 sends), and goes through as it is; only the
/// header's two bits for padding are DDS's own: set on the wire, and taken off again together with what it appended.
/// Topics are given as in ROS ("/tello1/odom"), types too ("nav_msgs/msg/Odometry").
namespace ledgerline::dds {

class Participant;
using ParticipantPtr = std::shared_ptr<Participant>;

/// As long as a value on the ledger may be. Longer messages are refused and counted, in both directions.
inline constexpr std::size_t max_message_bytes = contract::max_asset_bytes;

/// History is keep-last.
struct Qos {
  bool reliable = true;
  bool transient_local = false;
  int depth = 10;
  bool operator==(const Qos&) const = default;
};

/// Messages that were refused instead of handed on.
struct Refused {
  std::uint64_t malformed = 0;  ///< shorter than an encapsulation header, or one that is not PLAIN_CDR
  std::uint64_t too_long = 0;

  std::uint64_t total() const { return malformed + too_long; }
};

/// One topic of one type, written. Copies are the same writer; publish() may be called from any thread.
class RawWriter {
 public:
  /// A name or type that ROS 2 does not allow is an error.
  static Result<RawWriter> create(ParticipantPtr participant, const std::string& ros_topic, const std::string& ros_type,
                                  const Qos& qos);

  /// Copies `cdr`. A reliable reader that lags holds it up by 100 ms at most, then it is an error; otherwise the oldest
  /// message is overwritten. `source_time_ns`: the writing time that readers get, real time; 0: now.
  Status publish(std::span<const std::uint8_t> cdr, TimeNs source_time_ns = 0);
  Status publish(std::string_view cdr);
  /// Readers that are matched now.
  int readers() const;
  Refused refused() const;

 private:
  struct State;
  explicit RawWriter(std::shared_ptr<State> state) : state_(std::move(state)) {}
  std::shared_ptr<State> state_;
};

struct RawInfo {
  TimeNs source_time_ns = 0;              ///< real time, the writer's clock
  std::array<std::uint8_t, 16> writer{};  ///< its GUID; zeros where it was gone before its message was taken
};

/// As the decoders of common/msg take it.
inline std::string_view text_of(std::span<const std::uint8_t> cdr) {
  return {reinterpret_cast<const char*>(cdr.data()), cdr.size()};
}

/// Calls `callback` for each message, on a thread of DDS, one call at a time: hand over and return, and make or end no
/// reader or writer there. The bytes are valid during the call. Messages of writers with another type do not come (they
/// are not matched), nor those that this participant wrote itself. Keeps the newest `qos.depth` not yet taken.
/// Copies are the same reader: after the last one's end no call is running and none will come.
class RawReader {
 public:
  using Callback = std::function<void(std::span<const std::uint8_t> cdr, const RawInfo& info)>;
  static Result<RawReader> create(ParticipantPtr participant, const std::string& ros_topic, const std::string& ros_type,
                                  const Qos& qos, Callback callback);

  /// Writers that are matched now.
  int writers() const;
  Refused refused() const;
  /// Messages that DDS knows it did not deliver: gaps of best-effort writers, and what they overwrote.
  std::uint64_t lost() const;

 private:
  struct State;
  explicit RawReader(std::shared_ptr<State> state) : state_(std::move(state)) {}
  std::shared_ptr<State> state_;
};

/// What others have on one topic with one type: a topic whose type changes is seen to vanish with one and appear with
/// the other.
struct DiscoveredTopic {
  std::string topic, type;  ///< ROS's names
  /// With writers: what all of them offer, so that a reader which asks for it hears each. With readers alone: what
  /// satisfies all of them.
  Qos qos;
  int writers = 0, readers = 0;  ///< both 0: vanished
  /// The topic is there with another type too (of others or of this participant): the two do not hear each other.
  bool clash = false;
  bool operator==(const DiscoveredTopic&) const = default;
};

/// Topics of the domain as they appear, change and vanish. This participant's own readers and writers are left out, and
/// so is what is no topic of ROS 2 (services, DDS's own). Calls `callback` on a thread of DDS, one call at a time, the
/// first ones for what is there already: hand over and return, and make or end no reader or writer there.
/// Keeps `max_endpoints` readers and writers; those beyond are left out and counted.
class Discovery {
 public:
  using Callback = std::function<void(const DiscoveredTopic& seen)>;
  static Result<Discovery> create(ParticipantPtr participant, Callback callback, std::size_t max_endpoints = 10'000);

  std::uint64_t left_out() const;

 private:
  struct State;
  explicit Discovery(std::shared_ptr<State> state) : state_(std::move(state)) {}
  std::shared_ptr<State> state_;
};

/// A topic as this program reads it.
struct ReadTopic {
  std::string topic, type;
  Qos qos;
  std::string not_read{};  ///< why it is not read at all: nobody who writes it is heard; empty: it is
};

/// Why a reader does not hear somebody who writes its topic, as a sentence; empty: it hears all who do.
std::string why_unheard(const DiscoveredTopic& seen, const ReadTopic& read);

/// In all, of each topic. Of processes that come and go: a tenth is a morning of a pilot's tries, ten times as many are
/// a log that nobody reads.
inline constexpr int max_unheard_reports = 100;

/// Reports who writes one of these topics and is not heard, as why_unheard() has it, as long as the Discovery is kept:
/// each type, or QoS of the right type, when its first writer appears, also after the last one vanished; of a topic
/// max_unheard_reports times at most. With an empty `why`: all who write the topic are heard now. `read`: the index of
/// the topic; of one that is there twice, the first. As Discovery's callback.
using OnUnheard = std::function<void(std::size_t read, const std::string& why)>;
Result<Discovery> report_unheard(ParticipantPtr participant, std::vector<ReadTopic> topics, OnUnheard report);

}  // namespace ledgerline::dds
