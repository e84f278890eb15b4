#pragma once
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::hil {

/// Upper bound of every delay, set or drawn [ns]: a longer draw is cut to it.
inline constexpr TimeNs max_delay = 60 * ns_per_s;

/// How durations [ns] are distributed: plain data that may be copied and shared. Every draw is from 0 to max_delay;
/// what a formula gives outside is cut to that.
struct Distribution {
  enum class Kind { constant, uniform, normal, gamma, recorded };
  Kind kind = Kind::constant;
  TimeNs a = 0;  ///< [ns] constant: the value; uniform: the least; normal and gamma: the mean
  TimeNs b = 0;  ///< [ns] uniform: the most; normal and gamma: the standard deviation
  using Recording = std::shared_ptr<const std::vector<TimeNs>>;
  Recording values;  ///< [ns] recorded: in the order of the recording; never empty
  std::string file;  ///< recorded: for text_of()

  static Distribution constant(TimeNs value) { return {Kind::constant, value, 0, nullptr, {}}; }
};

/// Draws from distributions, the same ones for the same seed, on every machine. A recording is played in its order and
/// around, from a place that the seed chooses, so that what followed each other follows each other. One thread.
class Draws {
 public:
  explicit Draws(std::uint64_t seed) : random_(seed), next_(random_.next()) {}
  TimeNs next(const Distribution& distribution) noexcept;

 private:
  Random random_;
  std::uint64_t next_;
};

/// Where recordings come from.
using ReadRecording = std::function<Result<Distribution::Recording>(const std::string& path)>;
Result<Distribution::Recording> read_recording(const std::string& path);
/// From a file's content; `path` is for errors.
Result<Distribution::Recording> parse_recording(const std::string& path, std::string_view content);
/// Reads each file once, and returns that again whatever becomes of it; copies know what the others read. One thread.
template <typename What>
std::function<Result<What>(const std::string& path)> reading_once(
    std::function<Result<What>(const std::string& path)> read) {
  return [read = std::move(read),
          known = std::make_shared<std::map<std::string, What>>()](const std::string& path) -> Result<What> {
    if (const auto found = known->find(path); found != known->end()) return found->second;
    auto what = read(path);
    if (what) known->emplace(path, *what);
    return what;
  };
}

/// Reads one of
///     200ms                        constant; also `constant 200ms`. Units: us, ms, s
///     uniform 10ms 50ms            least and most
///     normal 50ms 10ms             mean and standard deviation
///     gamma 0.46s 0.2s             mean and standard deviation, which must be more than nothing
///     recorded delays.txt          a file of seconds, one a line; empty lines and those with # are passed over
/// The error quotes what is wrong and says what is allowed.
Result<Distribution> parse_distribution(std::string_view text, const ReadRecording& read = read_recording);
/// What parse_distribution() reads as the same again.
std::string text_of(const Distribution& distribution);

/// "200ms", "0.5s", "250us": nothing to max_delay.
Result<TimeNs> parse_time(std::string_view text);
/// The shortest such text: "200ms".
std::string time_text(TimeNs time);

}  // namespace ledgerline::hil
