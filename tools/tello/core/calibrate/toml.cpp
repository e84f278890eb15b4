#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "tools/tello/core/calibrate/estimate.hpp"

namespace ledgerline::tello {
namespace {

double degrees(double rad) { return rad * 180 / std::numbers::pi; }
double ms(double s) { return s * 1000; }

std::string response(const Answering& a, const char* what) {
  return fmt::format("# {}: lag {:.3f} s (sd {:.0f} ms), dead time {:.3f} s (sd {:.0f} ms)\n", what, a.lag_s.value,
                     ms(a.lag_s.sigma), a.dead_s.value, ms(a.dead_s.sigma));
}

// What a flight cannot show of its own floor, height and Wi-Fi, whatever the spread within it [A].
constexpr double other_floor_share = 0.02, other_way_s = 0.02;

std::string velocity(const Result<VelocityFit>& fit) {
  if (!fit) return "# No velocity_scale, velocity_truncated, velocity_lag_s: " + fit.error().message + ".\n";
  std::string out =
      fmt::format("velocity_scale = {:.3f}  # of vgx and vgy; sd {:.3f}\n", fit->scale.value, fit->scale.sigma);
  out += fmt::format("flow_scale = {:.3f}  # standard deviation of that: sd, and {} for another floor or height\n",
                     std::hypot(fit->scale.sigma / fit->scale.value, other_floor_share), other_floor_share);
  out += fmt::format("velocity_truncated = {}  # {:.2f} (sd {:.2f}) of a cast: 1 is one, 0 rounding\n", fit->truncated,
                     fit->cast.value, fit->cast.sigma);
  out += fmt::format("velocity_lag_s = {:.3f}  # sd {:.0f} ms\n", fit->lag_s.value, ms(fit->lag_s.sigma));
  out += fmt::format("velocity_lag_sd_s = {:.3f}  # sd, and {} for another Wi-Fi\n",
                     std::hypot(fit->lag_s.sigma, other_way_s), other_way_s);
  return out;
}

}  // namespace

std::string toml(const Calibration& c) {
  std::string out = "# Made by ledgerline tello calibrate. sd: standard deviation, by the spread within the flight.\n";
  out +=
      c.poses
          ? "# Velocities were measured by the pose source.\n"
          : "# Velocities are the drone's own: an error of its optical flow's scale is in all of them, and in no sd.\n";
  out += "\n[rc]  # of link.toml\n";
  out += fmt::format("full_scale_mps = {:.3f}  # forward and left; sd {:.3f}. Up and down: {:.3f}, sd {:.3f}\n",
                     c.along.full_scale.value, c.along.full_scale.sigma, c.up.full_scale.value, c.up.full_scale.sigma);
  out +=
      fmt::format("full_scale_radps = {:.3f}  # sd {:.3f}\n", c.turning.full_scale.value, c.turning.full_scale.sigma);
  out += fmt::format(
      "signs = [{}, {}, {}, {}]  # of a, b, c, d against left, forward (both by its tilt), up, counter-clockwise\n",
      c.rc_signs[0], c.rc_signs[1], c.rc_signs[2], c.rc_signs[3]);
  out += "\n[pose]  # of link.toml\n";
  out += fmt::format("velocity_signs = [{}, {}, {}]  # of vgx, vgy, vgz against forward, left, up\n",
                     c.velocity_signs[0], c.velocity_signs[1], c.velocity_signs[2]);
  out += fmt::format("velocity_frame = \"{}\"  # seen at two headings, a right angle apart\n",
                     c.velocity_in_body ? "body" : "power_on");
  out += velocity(c.velocity);
  if (c.nose_rad && c.power_on_rad) {
    out +=
        fmt::format("# The nose is {:.1f} degrees (sd {:.1f}) counter-clockwise of the x of the pose's orientation.\n",
                    degrees(c.nose_rad->value), degrees(c.nose_rad->sigma));
    out += fmt::format("# At power on it looked to {:.1f} degrees (sd {:.1f}) in the pose source's frame.\n",
                       degrees(c.power_on_rad->value), degrees(c.power_on_rad->sigma));
  }
  out += "\n[flight]  # of ground's file\n";
  out += fmt::format("full_scale_mps = {:.3f}  # link's rc.full_scale_mps\n", c.along.full_scale.value);
  out +=
      fmt::format("lag_s = {:.3f}  # forward and left; sd {:.0f} ms\n", c.along.lag_s.value, ms(c.along.lag_s.sigma));
  out +=
      fmt::format("# dead_s = {:.3f}  # sd {:.0f} ms; no key: ground learns it in flight. From an rc's sending, {}\n",
                  c.along.dead_s.value, ms(c.along.dead_s.sigma),
                  c.poses ? "the way to the drone included" : "the ways to the drone and back included");
  out += response(c.up, "Up and down");
  out += response(c.turning, "Yaw");
  return out;
}

}  // namespace ledgerline::tello
