#include "sim/core/pads.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

namespace ledgerline::sim {
namespace {

constexpr double degrees = 180 / std::numbers::pi;
constexpr int max_pad_id = 8;  // there are eight of them
constexpr double max_pad_m = 100, max_pad_size_m = 2;

Vector turned(const Vector& v, double yaw_rad) {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y(), v.z()};
}

std::optional<double> number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::vector<std::string_view> parts(std::string_view text, char between) {
  std::vector<std::string_view> out;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(between, begin), text.size());
    out.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return out;
}

Result<Pad> parse_pad(std::string_view text) {
  const Error wrong{
      fmt::format("\"{}\" is no mission pad: ID:X:Y, ID:X:Y:YAW or ID:X:Y:YAW:SIZE, ID 1 to {}, X and Y up to {:g} m, "
                  "YAW in degrees, "
                  "SIZE up to {:g} m",
                  text, max_pad_id, max_pad_m, max_pad_size_m)};
  std::vector<double> values;
  for (const std::string_view part : parts(text, ':')) {
    const auto value = number(part);
    if (!value) return wrong;
    values.push_back(*value);
  }
  if (values.size() < 3 || values.size() > 5) return wrong;
  Pad pad;
  if (values[0] != std::floor(values[0]) || values[0] < 1 || values[0] > max_pad_id) return wrong;
  pad.id = static_cast<int>(values[0]);
  if (std::abs(values[1]) > max_pad_m || std::abs(values[2]) > max_pad_m) return wrong;
  pad.x_m = values[1];
  pad.y_m = values[2];
  if (values.size() > 3) {
    if (std::abs(values[3]) > 360) return wrong;
    pad.yaw_rad = values[3] / degrees;
  }
  if (values.size() > 4) {
    if (values[4] <= 0 || values[4] > max_pad_size_m) return wrong;
    pad.size_m = values[4];
  }
  return pad;
}

}  // namespace

std::optional<PadSight> see_pad(const Parameters& parameters, const Body& body, Random& random) {
  const SensorParameters& s = parameters.sensors;
  const double height = body.position.z();
  if (height < s.pad_min_m || height > s.pad_max_m || tilt_of(body.attitude) > s.pad_max_tilt_rad) return std::nullopt;
  const Pad* nearest = nullptr;
  double nearest_m = 0;
  for (const Pad& pad : parameters.pads) {
    const double off_m = std::hypot(pad.x_m - body.position.x(), pad.y_m - body.position.y());
    // All of it has to be in the picture.
    if (off_m + pad.size_m / 2 > s.pad_reach_by_height * height) continue;
    if (nearest && off_m >= nearest_m) continue;
    nearest = &pad;
    nearest_m = off_m;
  }
  if (!nearest) return std::nullopt;
  PadSight sight;
  sight.id = nearest->id;
  sight.position = turned(body.position - Vector(nearest->x_m, nearest->y_m, 0), -nearest->yaw_rad);
  for (int axis = 0; axis < 3; ++axis) sight.position[axis] += s.pad_m * random.normal();
  sight.yaw_rad =
      std::remainder(yaw_of(body.attitude) - nearest->yaw_rad + s.pad_rad * random.normal(), 2 * std::numbers::pi);
  return sight;
}

Result<std::vector<Pad>> parse_pads(std::string_view text) {
  std::vector<Pad> pads;
  if (text.empty()) return pads;
  for (const std::string_view part : parts(text, ',')) {
    const auto pad = parse_pad(part);
    if (!pad) return pad.error();
    const bool twice = std::any_of(pads.begin(), pads.end(), [&](const Pad& other) { return other.id == pad->id; });
    if (twice)
      return Error{fmt::format("mission pad {} is there twice: a drone distinguishes pads by their id", pad->id)};
    pads.push_back(*pad);
  }
  return pads;
}

std::string pads_text(const std::vector<Pad>& pads) {
  std::string text;
  for (const Pad& pad : pads)
    text += fmt::format("{}{}:{:.10g}:{:.10g}:{:.10g}:{:.10g}", text.empty() ? "" : ",", pad.id, pad.x_m, pad.y_m,
                        pad.yaw_rad * degrees, pad.size_m);
  return text;
}

}  // namespace ledgerline::sim
