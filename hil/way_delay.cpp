#include "hil/way_delay.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace ledgerline::hil {
namespace {

constexpr TimeNs draw_period_ns = 100 * ns_per_ms;
constexpr double way_shape = 9, way_mean_s = 0.204;
constexpr double longest_added_s = 3;

}  // namespace

Result<AddedDelay> added_delay_from(const std::string& text) {
  if (text == "none") return AddedDelay{};
  if (text == "published") return AddedDelay{AddedDelay::Kind::published};
  double seconds = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  if (error != std::errc{} || end != text.data() + text.size() || !(seconds >= 0 && seconds <= longest_added_s))
    return Error{fmt::format("\"{}\" is no delay: none, published, or 0 to {} seconds", text, longest_added_s)};
  return AddedDelay{AddedDelay::Kind::constant, seconds};
}

TimeNs WayDelay::at(TimeNs now) {
  if (delay_.kind == AddedDelay::Kind::none) return 0;
  if (delay_.kind == AddedDelay::Kind::constant) return from_seconds(share_ * delay_.constant_s);
  if (now >= next_draw_ns_) {
    next_draw_ns_ = now + draw_period_ns;
    drawn_ns_ = from_seconds(2 * share_ * way_mean_s / way_shape * gamma(way_shape));
  }
  return drawn_ns_;
}

double WayDelay::gamma(double shape) {
  const double d = shape - 1.0 / 3, c = 1 / std::sqrt(9 * d);
  for (;;) {
    const double x = random_.normal();
    const double v = std::pow(1 + c * x, 3);
    if (v > 0 && std::log(1 - random_.uniform()) < 0.5 * x * x + d - d * v + d * std::log(v)) return d * v;
  }
}

}  // namespace ledgerline::hil
