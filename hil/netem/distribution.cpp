#include "hil/netem/distribution.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

constexpr std::size_t max_values = 1'000'000;
constexpr std::string_view distribution_forms =
    "a distribution is a time such as 200ms, or: uniform LEAST MOST, normal MEAN DEVIATION, gamma MEAN DEVIATION, "
    "recorded FILE";

TimeNs within_limits(double seconds) noexcept { return from_seconds(std::clamp(seconds, 0.0, to_seconds(max_delay))); }

// Marsaglia and Tsang, A Simple Method for Generating Gamma Variables (2000); for a shape below 1 its section 6.
double gamma_s(double mean, double deviation, Random& random) noexcept {
  const double shape = mean * mean / (deviation * deviation), scale = deviation * deviation / mean;
  const double boost = shape < 1 ? std::pow(1.0 - random.uniform(), 1.0 / shape) : 1.0;
  const double d = (shape < 1 ? shape + 1 : shape) - 1.0 / 3.0;
  const double c = 1.0 / std::sqrt(9.0 * d);
  for (;;) {
    const double x = random.normal();
    const double v = std::pow(1.0 + c * x, 3);
    const double u = 1.0 - random.uniform();
    if (v > 0 && std::log(u) < 0.5 * x * x + d - d * v + d * std::log(v)) return boost * d * v * scale;
  }
}

}  // namespace

Result<Distribution::Recording> parse_recording(const std::string& path, std::string_view content) {
  std::vector<TimeNs> values;
  for (const auto& [number, line] : lines_of(content)) {
    const auto seconds = parse_number(line);
    if (!seconds || *seconds < 0 || *seconds > to_seconds(max_delay))
      return Error{fmt::format("{}:{}: \"{}\" is no number of seconds from 0 to {:.0f}", path, number,
                               printable(line, 40), to_seconds(max_delay))};
    if (values.size() == max_values)
      return Error{fmt::format("{}: more than {} values: make it shorter", path, max_values)};
    values.push_back(from_seconds(*seconds));
  }
  if (values.empty()) return Error{path + ": no values: one number of seconds a line is expected"};
  return std::make_shared<const std::vector<TimeNs>>(std::move(values));
}

Result<Distribution::Recording> read_recording(const std::string& path) {
  const auto content = read_file(path);
  if (!content) return content.error();
  return parse_recording(path, *content);
}

TimeNs Draws::next(const Distribution& distribution) noexcept {
  const double a = to_seconds(distribution.a), b = to_seconds(distribution.b);
  switch (distribution.kind) {
    case Distribution::Kind::constant:
      return distribution.a;
    case Distribution::Kind::uniform:
      return within_limits(a + (b - a) * random_.uniform());
    case Distribution::Kind::normal:
      return within_limits(a + b * random_.normal());
    case Distribution::Kind::gamma:
      return within_limits(gamma_s(a, b, random_));
    case Distribution::Kind::recorded:
      return (*distribution.values)[next_++ % distribution.values->size()];
  }
  return 0;
}

Result<Distribution> parse_distribution(std::string_view text, const ReadRecording& read) {
  const auto words = words_of(text);
  if (words.empty()) return Error{fmt::format("a time is missing: {}", distribution_forms)};
  using Kind = Distribution::Kind;
  const auto* const known = std::ranges::find(enum_names<Kind>, words[0]);
  const bool named = known != enum_names<Kind>.end();
  const Kind kind = named ? static_cast<Kind>(known - enum_names<Kind>.begin()) : Kind::constant;
  const std::size_t needed = (named ? 1 : 0) + (kind == Kind::constant || kind == Kind::recorded ? 1 : 2);
  if (words.size() != needed) return Error{fmt::format("\"{}\": {}", printable(text, 80), distribution_forms)};
  if (kind == Kind::recorded) {
    const std::string file(words[1]);
    auto recording = read(file);
    if (!recording) return recording.error();
    return Distribution{kind, 0, 0, std::move(*recording), file};
  }

  const auto a = parse_time(words[named ? 1 : 0]);
  if (!a) return a.error();
  if (kind == Kind::constant) return Distribution::constant(*a);
  const auto b = parse_time(words[2]);
  if (!b) return b.error();
  if (kind == Kind::uniform && *b < *a)
    return Error{fmt::format("\"{}\": the least is more than the most", printable(text, 80))};
  if (kind == Kind::gamma && (*a <= 0 || *b <= 0))
    return Error{
        fmt::format("\"{}\": mean and deviation of a gamma distribution are more than nothing", printable(text, 80))};
  return Distribution{kind, *a, *b, nullptr, {}};
}

std::string text_of(const Distribution& distribution) {
  using Kind = Distribution::Kind;
  const std::string a = time_text(distribution.a);
  if (distribution.kind == Kind::constant) return a;
  if (distribution.kind == Kind::recorded) return "recorded " + distribution.file;
  return fmt::format("{} {} {}", enum_names<Kind>[static_cast<std::size_t>(distribution.kind)], a,
                     time_text(distribution.b));
}

Result<TimeNs> parse_time(std::string_view text) {
  static constexpr std::pair<std::string_view, double> units[] = {
      {"us", ns_per_us}, {"ms", ns_per_ms}, {"s", ns_per_s}};
  const double ns = std::round(parse_with_unit(text, units).value_or(-1));
  if (!(ns >= 0) || ns > static_cast<double>(max_delay))
    return Error{fmt::format("\"{}\" is no time from 0s to {:.0f}s, such as 200ms, 0.5s or 250us", printable(text, 40),
                             to_seconds(max_delay))};
  return static_cast<TimeNs>(ns);
}

std::string time_text(TimeNs time) {
  if (time % ns_per_s == 0) return fmt::format("{}s", time / ns_per_s);
  if (time % ns_per_ms == 0) return fmt::format("{}ms", time / ns_per_ms);
  return fmt::format("{}us", to_ms(time) * 1e3);
}

}  // namespace ledgerline::hil
