#pragma once
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::hil {

/// One moment of a link that was recorded, and what became of what was sent then.
struct RecordedDelay {
  TimeNs at_ns = 0;     ///< since the recording's start
  TimeNs delay_ns = 0;  ///< of what was sent then, where it came
  bool lost = false;
  bool operator==(const RecordedDelay&) const = default;
};

/// Loss and delay of a recorded link over time, played as it went on: not drawn. Between two moments the delay
/// goes evenly from the one to the other; whatever is sent from a lost moment until the next one is lost. At its end it
/// starts again; the last moment holds as long as the one before. Immutable; any thread.
class LinkRecording {
 public:
  static constexpr std::size_t max_moments = 1'000'000;
  static constexpr TimeNs max_length = 48 * 3600 * ns_per_s;

  /// An error where there are fewer than two moments or too many, where they do not ascend, or where a delay is
  /// negative or above max_delay; it says which moment.
  static Result<std::shared_ptr<const LinkRecording>> make(std::vector<RecordedDelay> moments);

  struct Delivery {
    bool lost = false;
    TimeNs delay_ns = 0;
  };
  /// Of what is sent so long after the start.
  Delivery at(TimeNs since_start) const noexcept;
  TimeNs length_ns() const noexcept { return length_ns_; }
  /// Anything is lost in it.
  bool has_losses() const noexcept { return loses_; }
  const std::vector<RecordedDelay>& moments() const noexcept { return moments_; }

 private:
  explicit LinkRecording(std::vector<RecordedDelay> moments);
  std::vector<RecordedDelay> moments_;
  TimeNs length_ns_ = 0;
  bool loses_ = false;
};

/// Two minutes of a crowded 2.4 GHz channel, made and not recorded: some 5 ms each way; every 9 s or so the radio
/// sleeps for 0.4 to 2.5 s and wakes with each beacon; every 7 s interference for 40 to 250 ms takes six of ten; every
/// 50 s a scan for 0.25 to 0.6 s takes all.
std::shared_ptr<const LinkRecording> crowded_link();

/// From a table's content; `path` is for errors. A line is `SECONDS,DELAY_S` or `SECONDS,lost`, with the seconds
/// ascending; the first may be the header `seconds,delay_s`; empty lines and those with # are passed over.
Result<std::shared_ptr<const LinkRecording>> parse_link_recording(const std::string& path, std::string_view content);
/// What parse_link_recording() reads as the same again, to a microsecond.
std::string table_of(const std::vector<RecordedDelay>& moments);

/// Where recordings come from: read_link_recording() of hil/netem/recording/link_recording.hpp, or a test's own.
using ReadLinkRecording = std::function<Result<std::shared_ptr<const LinkRecording>>(const std::string& path)>;

/// A table (parse_link_recording()), or a capture with one drone in it, of whose states the recording is made.
Result<std::shared_ptr<const LinkRecording>> read_link_recording(const std::string& path);

/// What of a capture a table is made.
struct RecordingOptions {
  std::string drone{};   ///< its address; empty: the only one
  bool answers = false;  ///< of commands and their answers; otherwise of states
};
/// The table of a capture, with a line about it before: what `ledgerline hil day` prints.
Result<std::string> table_of_capture(const std::string& path, const RecordingOptions& asked);

}  // namespace ledgerline::hil
