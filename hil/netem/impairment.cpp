#include "hil/netem/impairment.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "common/base/text.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

using Words = std::vector<std::string_view>;

constexpr double max_bytes_per_s = 1e9;
constexpr double max_queue_bytes = 64e6;
constexpr double smallest_queue_bytes = 2'000;  // a datagram of any Tello fits
constexpr double usual_queue_s = 0.25;

Error wrong(const Words& words, std::string_view why) {
  return Error{fmt::format("\"{}\": {}", printable(fmt::format("{}", fmt::join(words, " ")), 100), why)};
}

Result<double> share_in(std::string_view text) {
  const auto share = parse_share(text);
  if (!share) return Error{fmt::format("\"{}\" is no share from 0% to 100%, such as 5%", printable(text, 40))};
  return *share;
}

/// With the unit behind it: "20kB" and, of a rate, "20kB/s".
Result<double> parse_bytes(std::string_view text, std::string_view behind, double least, double most) {
  static constexpr std::pair<std::string_view, double> units[] = {{"kB", 1e3}, {"MB", 1e6}, {"B", 1}};
  if (text.ends_with(behind)) {
    const auto bytes = parse_with_unit(text.substr(0, text.size() - behind.size()), units);
    if (bytes && *bytes >= least && *bytes <= most) return *bytes;
  }
  return Error{fmt::format("\"{}\" is not from {}B{} to {:.0f}MB{}, such as 20kB{}", printable(text, 40), least, behind,
                           most / 1e6, behind, behind)};
}

std::string_view rest(std::string_view effect, std::string_view first_word) {
  return trimmed(effect.substr(first_word.size()));
}

Status set_distribution(std::string_view text, const ReadRecording& read, std::optional<Distribution>& out) {
  auto distribution = parse_distribution(text, read);
  if (!distribution) return distribution.error();
  out = std::move(*distribution);
  return done;
}

Status set_share(const Words& words, double& out) {
  if (words.size() != 2) return wrong(words, fmt::format("allowed is {} SHARE, such as {} 1%", words[0], words[0]));
  const auto share = share_in(words[1]);
  if (!share) return share.error();
  out = *share;
  return done;
}

Status set_loss(const Words& words, std::optional<Impairment::Loss>& out) {
  const bool bursts = words.size() > 1 && words[1] == "bursts";
  if (bursts ? words.size() < 4 || words.size() > 6 : words.size() != 2)
    return wrong(words, "allowed is loss SHARE, or loss bursts ENTER LEAVE [LOST_IN_THEM [LOST_BETWEEN]]");
  Impairment::Loss loss;
  double* const values[] = {&loss.enter, &loss.leave, &loss.bad, &loss.good};
  if (!bursts) {
    const auto share = share_in(words[1]);
    if (!share) return share.error();
    loss.good = *share;
  }
  for (std::size_t i = 2; i < words.size(); ++i) {
    const auto share = share_in(words[i]);
    if (!share) return share.error();
    *values[i - 2] = *share;
  }
  out = loss;
  return done;
}

/// Of duplication and reordering: a share and a distribution.
Status set_share_and_time(std::string_view effect, const Words& words, const ReadRecording& read, bool time_needed,
                          double& share, Distribution& time) {
  if (words.size() < (time_needed ? 3u : 2u))
    return wrong(words, fmt::format("allowed is {} SHARE {}, such as {} 5% 30ms", words[0],
                                    time_needed ? "DISTRIBUTION" : "[DISTRIBUTION]", words[0]));
  const auto parsed = share_in(words[1]);
  if (!parsed) return parsed.error();
  if (words.size() > 2) {
    auto distribution = parse_distribution(rest(rest(effect, words[0]), words[1]), read);
    if (!distribution) return distribution.error();
    time = std::move(*distribution);
  }
  share = *parsed;
  return done;
}

Status set_rate(const Words& words, std::optional<Impairment::Rate>& out) {
  const bool queue = words.size() == 4 && words[2] == "queue";
  if (words.size() != 2 && !queue)
    return wrong(words, "allowed is rate BYTES/s [queue BYTES], such as rate 20kB/s queue 8kB");
  const auto rate = parse_bytes(words[1], "/s", 1, max_bytes_per_s);
  if (!rate) return rate.error();
  double bytes = std::clamp(*rate * usual_queue_s, smallest_queue_bytes, max_queue_bytes);
  if (queue) {
    const auto asked = parse_bytes(words[3], "", 1, max_queue_bytes);
    if (!asked) return asked.error();
    bytes = *asked;
  }
  out = Impairment::Rate{*rate, static_cast<std::size_t>(bytes)};
  return done;
}

/// "90s", "250ms", "15min", "2h".
std::optional<TimeNs> offset_in(std::string_view text) {
  static constexpr std::pair<std::string_view, double> units[] = {{"ms", 1e-3}, {"min", 60}, {"s", 1}, {"h", 3600}};
  const auto seconds = parse_with_unit(text, units);
  if (!seconds || *seconds < 0 || *seconds > to_seconds(LinkRecording::max_length)) return std::nullopt;
  return std::llround(*seconds * 1e9);
}

Status set_recorded_link(const Words& words, const ReadLinkRecording& read,
                         std::optional<Impairment::RecordedLink>& out) {
  const bool from = words.size() == 4 && words[2] == "at";
  if (words.size() != 2 && !from)
    return wrong(words, "allowed is recorded-day FILE [at OFFSET], such as recorded-day day.csv at 90s");
  Impairment::RecordedLink recorded;
  recorded.file = words[1];
  auto recording = read(recorded.file);
  if (!recording) return recording.error();
  recorded.recording = std::move(*recording);
  const double length_s = to_seconds(recorded.recording->length_ns());
  if (from) {
    const auto offset = offset_in(words[3]);
    if (!offset || *offset >= recorded.recording->length_ns())
      return wrong(words,
                   fmt::format("the OFFSET must be a time such as 90s, 15min or 2h within the day, which is {:g} s "
                               "long",
                               length_s));
    recorded.offset_ns = *offset;
  }
  out = std::move(recorded);
  return done;
}

std::string recorded_text(const Impairment::RecordedLink& recorded) {
  if (recorded.offset_ns == 0) return "recorded-day " + recorded.file;
  return fmt::format("recorded-day {} at {}s", recorded.file, to_seconds(recorded.offset_ns));
}

std::string percent(double share) { return fmt::format("{:.12g}%", share * 100); }

std::string bytes_text(double bytes) {
  if (std::fmod(bytes, 1e3) == 0) return fmt::format("{:.15g}kB", bytes / 1e3);
  return fmt::format("{:.15g}B", bytes);
}

std::string loss_text(const Impairment::Loss& loss) {
  if (loss.enter == 0) return "loss " + percent(loss.good);
  std::string text = "loss bursts " + percent(loss.enter) + " " + percent(loss.leave);
  if (loss.bad != 1 || loss.good != 0) text += " " + percent(loss.bad);
  if (loss.good != 0) text += " " + percent(loss.good);
  return text;
}

/// Calls `act` with each effect's name and member, in the order of Impairment.
void for_each_effect(const auto& act) {
  act("delay", &Impairment::delay);
  act("jitter", &Impairment::jitter);
  act("loss", &Impairment::loss);
  act("duplicate", &Impairment::duplicate);
  act("reorder", &Impairment::reorder);
  act("corrupt", &Impairment::corrupt);
  act("truncate", &Impairment::truncate);
  act("rate", &Impairment::rate);
  act("recorded-day", &Impairment::recorded_link);
  act("stall", &Impairment::stall);
  act("partition", &Impairment::partition);
}

bool switch_off(std::string_view name, Impairment& impairment) {
  bool found = false;
  for_each_effect([&](std::string_view effect, auto member) {
    if (effect != name) return;
    impairment.*member = {};
    found = true;
  });
  return found;
}

}  // namespace

bool Impairment::any() const { return kinds_in(*this) != 0; }

unsigned kinds_in(const Impairment& impairment) {
  unsigned kinds = 0, bit = 1;
  for_each_effect([&](std::string_view, auto member) {
    if (static_cast<bool>(impairment.*member)) kinds |= bit;
    bit <<= 1;
  });
  return kinds;
}

void overlay(const Impairment& over, Impairment& impairment) {
  for_each_effect([&](std::string_view, auto member) {
    if (static_cast<bool>(over.*member)) impairment.*member = over.*member;
  });
}

Status apply_effect(std::string_view text, Impairment& impairment, const ReadRecording& read,
                    const ReadLinkRecording& recording) {
  const std::string_view effect = trimmed(text);
  const Words words = words_of(effect);
  constexpr std::string_view allowed =
      "allowed are delay, jitter, loss, duplicate, reorder, corrupt, truncate, rate, recorded-day, stall, partition, "
      "EFFECT off, and "
      "clear";
  if (words.empty()) return Error{fmt::format("an effect is missing: {}", allowed)};
  const std::string_view name = words[0];
  if (words.size() == 2 && words[1] == "off" && switch_off(name, impairment)) return done;
  const bool alone = words.size() == 1;
  if (name == "clear" && alone) return impairment = {}, done;
  if (name == "stall" && alone) return impairment.stall = true, done;
  if (name == "partition" && alone) return impairment.partition = true, done;
  if (name == "delay") return set_distribution(rest(effect, name), read, impairment.delay);
  if (name == "jitter") return set_distribution(rest(effect, name), read, impairment.jitter);
  if (name == "loss") return set_loss(words, impairment.loss);
  if (name == "corrupt") return set_share(words, impairment.corrupt);
  if (name == "truncate") return set_share(words, impairment.truncate);
  if (name == "recorded-day") return set_recorded_link(words, recording, impairment.recorded_link);
  if (name == "rate") return set_rate(words, impairment.rate);
  if (name == "duplicate") {
    Impairment::Duplication duplicate;
    auto set = set_share_and_time(effect, words, read, false, duplicate.share, duplicate.after);
    if (set) impairment.duplicate = std::move(duplicate);
    return set;
  }
  if (name == "reorder") {
    Impairment::Reordering reorder;
    auto set = set_share_and_time(effect, words, read, true, reorder.share, reorder.by);
    if (set) impairment.reorder = std::move(reorder);
    return set;
  }
  return wrong(words, allowed);
}

Status apply_effects(std::string_view text, Impairment& impairment, const ReadRecording& read,
                     const ReadLinkRecording& recording) {
  Impairment changed = impairment;
  for (const std::string_view effect : split(text, ',')) {
    if (auto applied = apply_effect(effect, changed, read, recording); !applied) return applied;
  }
  impairment = std::move(changed);
  return done;
}

std::string text_of(const Impairment& impairment) {
  std::vector<std::string> effects;
  if (impairment.delay) effects.push_back("delay " + text_of(*impairment.delay));
  if (impairment.jitter) effects.push_back("jitter " + text_of(*impairment.jitter));
  if (impairment.loss) effects.push_back(loss_text(*impairment.loss));
  if (const auto& d = impairment.duplicate)
    effects.push_back("duplicate " + percent(d->share) + " " + text_of(d->after));
  if (const auto& r = impairment.reorder) effects.push_back("reorder " + percent(r->share) + " " + text_of(r->by));
  if (impairment.corrupt > 0) effects.push_back("corrupt " + percent(impairment.corrupt));
  if (impairment.truncate > 0) effects.push_back("truncate " + percent(impairment.truncate));
  if (const auto& r = impairment.rate)
    effects.push_back(
        fmt::format("rate {}/s queue {}", bytes_text(r->bytes_per_s), bytes_text(static_cast<double>(r->queue_bytes))));
  if (impairment.recorded_link) effects.push_back(recorded_text(*impairment.recorded_link));
  if (impairment.stall) effects.push_back("stall");
  if (impairment.partition) effects.push_back("partition");
  return effects.empty() ? "clear" : fmt::format("{}", fmt::join(effects, ", "));
}

Status check_for_stream(const Impairment& impairment) {
  const std::pair<bool, const char*> effects[] = {
      {impairment.loss.has_value(), "loss"},
      {impairment.duplicate.has_value(), "duplicate"},
      {impairment.reorder.has_value(), "reorder"},
      {impairment.corrupt > 0, "corrupt"},
      {impairment.truncate > 0, "truncate"},
      {impairment.recorded_link && impairment.recorded_link->recording->has_losses(), "a recorded day with losses"},
  };
  for (const auto& [there, name] : effects) {
    if (there)
      return Error{
          fmt::format("{} is of datagrams: a stream (TCP) delivers what was sent, in order, or nothing; it can "
                      "have delay, jitter, rate, stall and partition",
                      name)};
  }
  return done;
}

}  // namespace ledgerline::hil
