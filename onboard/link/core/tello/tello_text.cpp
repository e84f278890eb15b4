#include "onboard/link/core/tello/tello_text.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <cmath>

namespace ledgerline::link {

namespace {

// A finite number that takes the whole text; from_chars knows no locale and does not allocate.
bool parse_number(std::string_view text, float& out) noexcept {
  float value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value)) return false;
  out = value;
  return true;
}

constexpr std::array<std::string_view, 3> attitude_keys{"roll", "pitch", "yaw"};
constexpr std::array<std::string_view, 3> acceleration_keys{"agx", "agy", "agz"};
constexpr std::array<std::string_view, 3> velocity_keys{"vgx", "vgy", "vgz"};
constexpr std::array<std::string_view, 3> pad_keys{"x", "y", "z"};
constexpr int last_pad = 8;  // the SDK's pads are 1 to 8; SDK 1.3 says 257

// -1: none of them.
int index_of(const std::array<std::string_view, 3>& keys, std::string_view key) noexcept {
  const auto at = std::find(keys.begin(), keys.end(), key);
  return at == keys.end() ? -1 : static_cast<int>(at - keys.begin());
}

bool begins_with(std::string_view text, std::string_view lower) noexcept {
  if (text.size() < lower.size()) return false;
  for (std::size_t i = 0; i < lower.size(); ++i) {
    const char c = text[i];
    if ((c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c) != lower[i]) return false;
  }
  return true;
}

char* append(char* at, char* end, int number) noexcept {
  *at++ = ' ';
  return std::to_chars(at, end, number).ptr;
}

Eigen::Matrix2f rotation(double yaw_rad) noexcept {
  return Eigen::Rotation2Dd(yaw_rad).toRotationMatrix().cast<float>();
}

}  // namespace

bool parse_state(std::string_view bytes, TelloState& state) noexcept {
  TelloState parsed = state;
  parsed.has_barometer = false;
  parsed.has_motor_time = false;
  parsed.pad = -2;
  bool height = false, tof = false, battery = false, warm = false;
  std::array<bool, 3> velocity{};
  // What has no semicolon behind is the line's end, or a field that is torn: "bat:1" of "bat:100;".
  for (std::size_t end; (end = bytes.find(';')) != std::string_view::npos; bytes.remove_prefix(end + 1)) {
    const std::string_view field = bytes.substr(0, end);
    const std::size_t colon = field.find(':');
    if (colon == std::string_view::npos) continue;
    const std::string_view key = field.substr(0, colon);
    float value = 0;
    if (key == "mpry") {  // pitch, roll and yaw, comma between
      const std::string_view yaw = field.substr(field.rfind(',') + 1);
      if (parse_number(yaw, value) && std::abs(value) <= 360) parsed.on_pad_yaw_deg = value;
      continue;
    }
    if (!parse_number(field.substr(colon + 1), value)) continue;
    // Beyond these ranges it is not a Tello that speaks (the ToF sensor's "nothing seen" is 6553 or 8192).
    if (key == "h" && std::abs(value) < 20'000) {
      parsed.height_m = value / 100;
      height = true;
    } else if (key == "tof" && value >= 0 && value < 10'000) {
      parsed.tof_m = value / 100;
      tof = true;
    } else if (key == "bat" && value >= 0 && value <= 100) {
      parsed.battery = value / 100;
      battery = true;
    } else if (const int axis = index_of(attitude_keys, key); axis >= 0 && std::abs(value) <= 360) {
      parsed.attitude_deg[static_cast<std::size_t>(axis)] = value;
    } else if (const int along = index_of(acceleration_keys, key); along >= 0 && std::abs(value) < 50'000) {
      parsed.acceleration_mg[static_cast<std::size_t>(along)] = value;
    } else if (const int way = index_of(velocity_keys, key); way >= 0 && std::abs(value) < 1'000) {
      parsed.velocity_dmps[static_cast<std::size_t>(way)] = value;
      velocity[static_cast<std::size_t>(way)] = true;
    } else if (const int side = index_of(pad_keys, key); side >= 0 && std::abs(value) < 10'000) {
      parsed.on_pad_m[static_cast<std::size_t>(side)] = value / 100;
    } else if (key == "mid" && value >= -2 && value <= last_pad) {
      parsed.pad = static_cast<int>(value);
    } else if ((key == "templ" || key == "temph") && std::abs(value) < 200) {
      parsed.temperature_c = warm ? std::max(parsed.temperature_c, value) : value;
      warm = true;
    } else if (key == "baro" && std::abs(value) < 20'000) {
      parsed.barometer_m = value;
      parsed.has_barometer = true;
    } else if (key == "time" && value >= 0 && value < 1e6F) {
      parsed.motor_s = static_cast<int>(value);
      parsed.has_motor_time = true;
    }
  }
  parsed.has_velocity = velocity[0] && velocity[1] && velocity[2];
  if (!height || !tof || !battery) return false;
  state = parsed;
  return true;
}

std::string_view without_line_end(std::string_view bytes) noexcept {
  while (!bytes.empty() &&
         (bytes.back() == '\r' || bytes.back() == '\n' || bytes.back() == ' ' || bytes.back() == '\0')) {
    bytes.remove_suffix(1);
  }
  return bytes;
}

Answer parse_answer(std::string_view bytes) noexcept {
  bytes = without_line_end(bytes);
  if (bytes.size() == 2 && begins_with(bytes, "ok")) return Answer::ok;
  if (begins_with(bytes, "error") || begins_with(bytes, "out of range") || begins_with(bytes, "unknown command")) {
    return Answer::refused;
  }
  return Answer::unknown;
}

CommandText rc_text(const Rc& rc) noexcept {
  CommandText text("rc");
  char* const begin = text.bytes.data();
  char* at = begin + text.size;
  // Max: "rc -100 -100 -100 -100", 22 bytes.
  for (const int channel : rc) at = append(at, begin + text.bytes.size(), std::clamp(channel, -100, 100));
  text.size = static_cast<std::uint8_t>(at - begin);
  return text;
}

BodyCommand to_body(const RcSettings& settings, const Velocity& velocity, double yaw_rad) noexcept {
  const Eigen::Vector2f level = rotation(-yaw_rad) * Eigen::Vector2f(velocity.mps[0], velocity.mps[1]);
  const float forward = level.x(), left = level.y(), up = velocity.mps[2];

  const float largest = std::max({std::abs(forward), std::abs(left), std::abs(up)});
  const float shorter = largest > settings.full_scale_mps ? settings.full_scale_mps / largest : 1.0F;
  const float yaw = std::clamp(velocity.yaw_radps, -settings.full_scale_radps, settings.full_scale_radps);

  const float per_mps = 100 * shorter / settings.full_scale_mps;
  const std::array<float, 4> channels{left * per_mps, forward * per_mps, up * per_mps,
                                      yaw * 100 / settings.full_scale_radps};
  BodyCommand command;
  for (std::size_t i = 0; i < 4; ++i) command.rc[i] = static_cast<int>(std::lround(settings.signs[i] * channels[i]));
  for (std::size_t i = 0; i < 3; ++i) command.sent.mps[i] = velocity.mps[i] * shorter;
  command.sent.yaw_radps = yaw;
  return command;
}

Velocity to_map(const Velocity& body, double yaw_rad) noexcept {
  const Eigen::Vector2f level = rotation(yaw_rad) * Eigen::Vector2f(body.mps[0], body.mps[1]);
  return {{level.x(), level.y(), body.mps[2]}, body.yaw_radps};
}

}  // namespace ledgerline::link
