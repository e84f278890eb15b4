#include "hil/sitl/ledger/way_delay.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace ledgerline::hil {
namespace {

constexpr TimeNs draw_period_ns = 100 * ns_per_ms;
constexpr double max_added_s = 3;

Result<AddedDelay> recorded_from(const std::string& file, const ReadRecording& read) {
  auto recording = read(file);
  if (!recording) return recording.error();
  const TimeNs max_delay = *std::max_element((*recording)->begin(), (*recording)->end());
  if (max_delay > from_seconds(max_added_s))
    return Error{
        fmt::format("{}: {} s is longer than the {} s that can be added", file, to_seconds(max_delay), max_added_s)};
  return AddedDelay{.own = Distribution{Distribution::Kind::recorded, 0, 0, std::move(*recording), file}};
}

}  // namespace

double PublishedDelay::quantile(double share) const {
  std::size_t to = 1;
  while (to + 1 < shares.size() && share >= shares[to]) ++to;
  const double part = (share - shares[to - 1]) / (shares[to] - shares[to - 1]);
  return quantiles_s[to - 1] + part * (quantiles_s[to] - quantiles_s[to - 1]);
}

Result<AddedDelay> added_delay_from(const std::string& text, const ReadRecording& read) {
  if (text == "none") return AddedDelay{};
  const auto* known = std::find_if(published_delays.begin(), published_delays.end(),
                                   [&](const PublishedDelay& one) { return one.name == text; });
  if (known != published_delays.end()) return AddedDelay{.published = known};
  double seconds = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  if (error != std::errc{} || end != text.data() + text.size()) return recorded_from(text, read);
  if (!(seconds >= 0 && seconds <= max_added_s))
    return Error{fmt::format("{} is no delay from 0 to {} seconds", text, max_added_s)};
  return AddedDelay{.own = Distribution::constant(from_seconds(seconds))};
}

TimeNs WayDelay::draw() {
  if (delay_.published) return from_seconds(delay_.published->quantile(random_.uniform()));
  return delay_.own ? draws_of_own_.next(*delay_.own) : 0;
}

TimeNs WayDelay::at(TimeNs now) {
  const auto period = static_cast<std::uint64_t>(now / draw_period_ns);
  while (drawn_ <= period) draws_[drawn_++ % kept] = draw();
  const auto part = [&](std::uint64_t k, double share) {
    return std::llround(static_cast<double>(draws_[k % kept]) * share);
  };
  std::uint64_t chosen = period;
  if (way_ == Way::back) {
    const std::uint64_t oldest = period - std::min(period, kept - 1);
    const auto begin = [](std::uint64_t k) { return static_cast<TimeNs>(k) * draw_period_ns; };
    while (chosen > oldest && begin(chosen) + part(chosen, 1 - share_) > now) --chosen;
  }
  return part(chosen, share_);
}

}  // namespace ledgerline::hil
