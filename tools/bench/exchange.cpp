#include "tools/bench/exchange.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace ledgerline::bench {
namespace {

constexpr double stream_hz = 35;
constexpr double fast_rate = 70;
constexpr double max_settle_s = 2;

}  // namespace

Schedule make_schedule(int rate, double warm_up_s, double seconds, double drain_s) {
  const double settle_s = std::min(max_settle_s, warm_up_s / 2);
  Schedule schedule;
  schedule.per_s = rate / 2.0;
  schedule.streams = std::max(1, static_cast<int>(std::ceil(schedule.per_s / stream_hz)));
  schedule.fast_per_s = std::max(fast_rate / 2, schedule.per_s);
  schedule.fast_count = static_cast<std::uint64_t>((warm_up_s - settle_s) * schedule.fast_per_s);
  schedule.first = schedule.fast_count + static_cast<std::uint64_t>(settle_s * schedule.per_s);
  schedule.count = std::max<std::uint64_t>(1, static_cast<std::uint64_t>(seconds * schedule.per_s));
  schedule.drain_s = drain_s;
  return schedule;
}

TimeNs Schedule::due_ns(std::uint64_t n) const {
  const double fast = static_cast<double>(std::min(n, fast_count)) / fast_per_s;
  const double rest = n > fast_count ? static_cast<double>(n - fast_count) / per_s : 0;
  return from_seconds(fast + rest);
}

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Schedule, streams, fast_per_s, fast_count, per_s, first, count, drain_s)

std::string write_schedule(const Schedule& schedule) { return nlohmann::json(schedule).dump(); }

Result<Schedule> read_schedule(const std::string& text) {
  const auto json = nlohmann::json::parse(text, nullptr, false);
  for (const char* key : {"streams", "fast_per_s", "fast_count", "per_s", "first", "count", "drain_s"}) {
    if (!json.is_object() || !json.contains(key) || !json[key].is_number() || json[key].get<double>() < 0) {
      return Error{fmt::format("the schedule has no {}: {}", key, text)};
    }
  }
  const auto schedule = json.get<Schedule>();
  constexpr int max_streams = 16;
  if (schedule.streams < 1 || schedule.streams > max_streams || schedule.per_s <= 0 || schedule.fast_per_s <= 0) {
    return Error{"the schedule is for no message, or for more than 16 streams: " + text};
  }
  return schedule;
}

double Schedule::length_s() const { return to_seconds(due_ns(first + count)) + drain_s; }

void Account::sent(TimeNs now, std::uint64_t n) {
  open_[n % open_.size()].insert({n, now});
  past_ = past_ || n >= schedule_.first + schedule_.count;
  if (!measured(n)) return;
  ++sent_;
  ++open_measured_;
}

void Account::close(TimeNs now, const Open& open) {
  if (!measured(open.n)) return;
  --open_measured_;
  times_.push_back(now - open.at);
}

bool Account::answered(TimeNs now, std::uint64_t n, TimeNs stamp) {
  std::set<Open>& open = open_[n % open_.size()];
  const auto found = open.find({n, 0});
  if (found == open.end() || found->at != stamp) return false;
  ++answers_;
  close(now, *found);
  if (measured(n)) ++answered_;
  auto older = in_order_ ? open.begin() : found;
  for (; older != found; older = open.erase(older)) {
    close(now, *older);
    if (measured(older->n)) ++replaced_;
  }
  open.erase(found);
  return true;
}

void Account::end(TimeNs now) {
  for (auto& stream : open_) {
    for (const Open& open : stream) close(now, open);
    stream.clear();
  }
}

std::string write_message(const Message& message, const std::string& topic) {
  static const std::string zeros = [] {
    std::string list = "[0";
    for (int i = 1; i < 36; ++i) list += ",0";
    return list + "]";
  }();
  return fmt::format(
      R"({{"topic":"{}","msg_type":"nav_msgs/msg/Odometry","msg":{{"header":{{"seq":{},"stamp":{{"sec":{},"nanosec":{}}},)"
      R"("frame_id":"map"}},"child_frame_id":"base_link","pose":{{"pose":{{"position":{{"x":0.75,"y":-0.25,"z":1.02}},)"
      R"("orientation":{{"x":0,"y":0,"z":0.38,"w":0.92}}}},"covariance":{}}},"twist":{{"twist":{{)"
      R"("linear":{{"x":0.5,"y":0,"z":0}},"angular":{{"x":0,"y":0,"z":0.1}}}},"covariance":{}}}}}}})",
      topic, message.n, message.stamp_ns / ns_per_s, message.stamp_ns % ns_per_s, zeros, zeros);
}

bool read_message(const std::string& text, Message& message) {
  const auto json = nlohmann::json::parse(text, nullptr, false);
  const nlohmann::json::json_pointer header("/msg/header");
  if (!json.is_object() || !json.contains(header)) return false;
  const auto& h = json[header];
  if (!h.is_object() || !h.contains("seq") || !h["seq"].is_number_unsigned()) return false;
  for (const char* part : {"sec", "nanosec"}) {
    if (!h.contains("stamp") || !h["stamp"].is_object() || !h["stamp"].contains(part) ||
        !h["stamp"][part].is_number_unsigned()) {
      return false;
    }
  }
  message.n = h["seq"].get<std::uint64_t>();
  message.stamp_ns = h["stamp"]["sec"].get<TimeNs>() * ns_per_s + h["stamp"]["nanosec"].get<TimeNs>();
  return true;
}

}  // namespace ledgerline::bench
