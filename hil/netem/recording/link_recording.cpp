#include "hil/netem/recording/link_recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <iterator>

#include "common/base/file.hpp"
#include "common/base/random.hpp"
#include "common/base/text.hpp"
#include "hil/netem/distribution.hpp"
#include "hil/netem/recording/capture.hpp"
#include "hil/netem/recording/lateness.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

/// Of a table's line: seconds, up to a bound.
std::optional<TimeNs> time_in(std::string_view text, TimeNs most) {
  const auto seconds = parse_number(trimmed(text));
  if (!seconds || *seconds < 0 || *seconds > to_seconds(most)) return std::nullopt;
  return std::llround(*seconds * 1e9);
}

}  // namespace

LinkRecording::LinkRecording(std::vector<RecordedDelay> moments) : moments_(std::move(moments)) {
  const TimeNs last = moments_.back().at_ns;
  length_ns_ = last + (last - moments_[moments_.size() - 2].at_ns);
  loses_ = std::any_of(moments_.begin(), moments_.end(), [](const RecordedDelay& moment) { return moment.lost; });
}

Result<std::shared_ptr<const LinkRecording>> LinkRecording::make(std::vector<RecordedDelay> moments) {
  if (moments.size() < 2) return Error{fmt::format("{} moments: a day has at least two", moments.size())};
  if (moments.size() > max_moments)
    return Error{fmt::format("{} moments: {} are the most", moments.size(), max_moments)};
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const RecordedDelay& moment = moments[i];
    if (moment.at_ns < 0 || moment.at_ns > max_length || (i > 0 && moment.at_ns <= moments[i - 1].at_ns))
      return Error{fmt::format("moment {} at {} s: they must ascend, from 0 to {:.0f} s", i + 1,
                               to_seconds(moment.at_ns), to_seconds(max_length))};
    if (moment.delay_ns < 0 || moment.delay_ns > max_delay)
      return Error{fmt::format("moment {} has a delay of {} s: 0 to {:.0f} s can be", i + 1,
                               to_seconds(moment.delay_ns), to_seconds(max_delay))};
  }
  return std::shared_ptr<const LinkRecording>(new LinkRecording(std::move(moments)));
}

LinkRecording::Delivery LinkRecording::at(TimeNs since_start) const noexcept {
  const TimeNs t = std::max<TimeNs>(0, since_start) % length_ns_;
  const auto next = std::upper_bound(moments_.begin(), moments_.end(), t,
                                     [](TimeNs time, const RecordedDelay& moment) { return time < moment.at_ns; });
  const RecordedDelay& now = next == moments_.begin() ? *next : *std::prev(next);
  if (now.lost) return {true, 0};
  if (next == moments_.begin() || next == moments_.end() || next->lost) return {false, now.delay_ns};
  const double share = static_cast<double>(t - now.at_ns) / static_cast<double>(next->at_ns - now.at_ns);
  return {false, now.delay_ns + std::llround(share * static_cast<double>(next->delay_ns - now.delay_ns))};
}

std::shared_ptr<const LinkRecording> crowded_link() {
  constexpr TimeNs length = 120 * ns_per_s, step = 30 * ns_per_ms, beacon = 102'400 * ns_per_us;
  Random random(1);
  const auto drawn = [&](double from_s, double to_s) {
    return from_seconds(from_s + random.uniform() * (to_s - from_s));
  };
  struct Spell {
    double every_s, from_s, to_s;  ///< how often it comes, how long it lasts
    TimeNs begin = 0, end = 0;
  };
  Spell sleep{9, 0.4, 2.5}, interference{7, 0.04, 0.25}, scan{50, 0.25, 0.6};
  const auto lasts = [&](Spell& spell, TimeNs t) {
    if (t >= spell.end) {
      spell.begin = t + drawn(0.5 * spell.every_s, 1.5 * spell.every_s);
      spell.end = spell.begin + drawn(spell.from_s, spell.to_s);
    }
    return t >= spell.begin;
  };
  std::vector<RecordedDelay> moments;
  for (TimeNs t = 0; t < length; t += step) {
    RecordedDelay moment{t, drawn(0.003, 0.007)};
    if (lasts(sleep, t)) moment.delay_ns += beacon - t % beacon;
    if (lasts(interference, t)) moment.lost = random.uniform() < 0.6;
    if (lasts(scan, t)) moment.lost = true;
    moments.push_back(moment);
  }
  return *LinkRecording::make(std::move(moments));
}

Result<std::shared_ptr<const LinkRecording>> parse_link_recording(const std::string& path, std::string_view content) {
  std::vector<RecordedDelay> moments;
  for (const auto& [line_number, line_text] : lines_of(content)) {
    const int number = line_number;  // no lambda captures a part of a pair
    const std::string_view line = line_text;
    if (moments.empty() && line == "seconds,delay_s") continue;
    const std::size_t comma = std::min(line.find(','), line.size());
    const std::string_view delivery = trimmed(line.substr(std::min(comma + 1, line.size())));
    const auto at = time_in(line.substr(0, comma), LinkRecording::max_length);
    const bool lost = delivery == "lost";
    const auto delay = lost ? std::optional<TimeNs>(0) : time_in(delivery, max_delay);
    const auto wrong = [&](std::string_view why) {
      return Error{fmt::format("{}:{}: \"{}\" {}", path, number, printable(line, 40), why)};
    };
    if (!at || !delay)
      return wrong(
          fmt::format("must be SECONDS,DELAY_S or SECONDS,lost: a time up to {:.0f} s and a delay up to {:.0f} s",
                      to_seconds(LinkRecording::max_length), to_seconds(max_delay)));
    if (!moments.empty() && *at <= moments.back().at_ns) return wrong("is not later than the line before");
    if (moments.size() == LinkRecording::max_moments)
      return wrong(fmt::format("is one too many: {} moments are the most", LinkRecording::max_moments));
    moments.push_back({*at, *delay, lost});
  }
  if (moments.size() < 2)
    return Error{path + ": a day has at least two moments: lines as 0.1,0.025 or 0.2,lost are expected"};
  return LinkRecording::make(std::move(moments));
}

std::string table_of(const std::vector<RecordedDelay>& moments) {
  std::string text = "seconds,delay_s\n";
  for (const RecordedDelay& moment : moments) {
    fmt::format_to(std::back_inserter(text), "{:.6f},", to_seconds(moment.at_ns));
    if (moment.lost) {
      text += "lost\n";
    } else {
      fmt::format_to(std::back_inserter(text), "{:.6f}\n", to_seconds(moment.delay_ns));
    }
  }
  return text;
}

namespace {

/// By its first four bytes: pcap of micro- and nanoseconds in either order of bytes, and pcapng.
bool is_capture(const std::string& path) {
  std::uint32_t magic = 0;
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(&magic), sizeof magic);
  constexpr std::array<std::uint32_t, 5> known{0xa1b2c3d4, 0xd4c3b2a1, 0xa1b23c4d, 0x4d3cb2a1, 0x0a0d0d0a};
  return file && std::find(known.begin(), known.end(), magic) != known.end();
}

Result<MeasuredLink> measured(const std::string& path, const RecordingOptions& asked, std::string& drone) {
  const auto links = read_capture(path);
  if (!links) return links.error();
  const auto link = link_of(*links, asked.drone);
  if (!link) return Error{fmt::format("{}: {}", path, link.error().message)};
  drone = link->drone;
  auto recording = asked.answers ? recording_of_answers(link->asked) : recording_of_states(link->states);
  if (!recording) return Error{fmt::format("{}: {}: {}", path, drone, recording.error().message)};
  return recording;
}

}  // namespace

Result<std::shared_ptr<const LinkRecording>> read_link_recording(const std::string& path) {
  if (is_capture(path)) {
    std::string drone;
    auto recording = measured(path, {}, drone);
    if (!recording) return recording.error();
    auto made = LinkRecording::make(std::move(recording->moments));
    if (!made) return Error{fmt::format("{}: {}", path, made.error().message)};
    return made;
  }
  const auto content = read_file(path);
  if (!content) return content.error();
  return parse_link_recording(path, *content);
}

Result<std::string> table_of_capture(const std::string& path, const RecordingOptions& asked) {
  std::string drone;
  const auto recording = measured(path, asked, drone);
  if (!recording) return recording.error();
  const std::string about =
      asked.answers
          ? fmt::format("# answers of {}: {} came, {} missing; delays are half of the time from command to answer\n",
                        drone, recording->came, recording->missing)
          : fmt::format("# states of {}: {} came, {} missing, one every {:.3f} ms; delays are beyond the least one\n",
                        drone, recording->came, recording->missing, recording->period_s * 1e3);
  return about + table_of(recording->moments);
}

}  // namespace ledgerline::hil
