#pragma once
#include <bitset>
#include <cstdint>
#include <span>
#include <string_view>

#include "common/msg/onboard.hpp"
#include "common/rt/fixed_vector.hpp"
#include "common/rt/trace.hpp"
#include "onboard/link/core/tello/serial_check.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

/// What goes into a step of link, and what comes out of it.
namespace ledgerline::link {

/// The two ports of a drone that link hears: answers (8889) and state text (8890).
enum class Port : std::uint8_t { answer, state };

struct Received {
  DroneNumber drone = 0;
  Port port = Port::answer;
  std::string_view bytes;
};

struct ToSend {
  DroneNumber drone = 0;
  CommandText command;
};

/// What the check of a drone's serial came to, for people.
struct SerialReport {
  DroneNumber drone = 0;
  SerialCheck::Verdict verdict = SerialCheck::Verdict::unwanted;
  SerialText answered;
};

/// What a drone said that people are to read.
struct DroneWords {
  enum class Kind : std::uint8_t {
    takeoff_refused,  ///< its answer to `takeoff`
    state_unreadable  ///< what comes in place of state texts
  };
  DroneNumber drone = 0;
  Kind kind = Kind::takeoff_refused;
  Quote text;
};

/// What came since the last step, in the order it came.
struct LinkInputs {
  std::span<const Received> received;
  std::span<const Plan> plans;
  std::span<const Pose> poses;
  std::span<const AgentHeartbeat> heartbeats;
  bool stop_all = false;           ///< the local stop key (SIGTERM): every drone lands; stays true once it was
  TimeNs suspended_ns = 0;         ///< how long this host was suspended since it booted (LoopClock)
  bool clear_local_stops = false;  ///< the local stops are cleared by somebody at this host (SIGUSR1)
};

using DroneSet = std::bitset<max_drones + 1>;

struct LinkOutputs {
  FixedVector<ToSend, 4 * max_drones> to_send;
  FixedVector<StateSample, max_drones> states;
  FixedVector<Transition, max_drones> transitions;  ///< what is lost on the way comes again
  FixedVector<SerialReport, max_drones> serials;    ///< each time that one of them changed
  FixedVector<DroneWords, 2 * max_drones> words;
  FixedVector<TraceRecord, 512> trace;

  /// Refusals stay counted.
  void clear() noexcept {
    to_send.clear();
    states.clear();
    transitions.clear();
    serials.clear();
    words.clear();
    trace.clear();
  }
};

/// What all drones share in a step of link.
struct LinkMoment {
  TimeNs now;
  bool healthy;  ///< steps come in time, and have for LinkSettings::health_rest_ns
  /// The host was suspended before: what is stamped earlier is older than it says. 0: it was not.
  TimeNs not_before_ns = 0;
  bool stop_all;              ///< the local stop key was pressed
  bool check_failed = false;  ///< one of link's core, or of agent's
  LinkOutputs& out;
};

}  // namespace ledgerline::link
