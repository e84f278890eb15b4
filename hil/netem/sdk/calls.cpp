#include "hil/netem/sdk/calls.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>

namespace ledgerline::hil {
namespace {

constexpr auto unanswered = std::to_array<std::string_view>({"rc", "reboot"});
constexpr auto moves = std::to_array<std::string_view>(
    {"takeoff", "land", "up", "down", "left", "right", "forward", "back", "cw", "ccw", "flip", "go", "curve", "jump"});
constexpr auto answered_at_once = std::to_array<std::string_view>({"command",
                                                                   "emergency",
                                                                   "stop",
                                                                   "keepalive",
                                                                   "speed",
                                                                   "mon",
                                                                   "moff",
                                                                   "mdirection",
                                                                   "streamon",
                                                                   "streamoff",
                                                                   "motoron",
                                                                   "motoroff",
                                                                   "throwfly",
                                                                   "port",
                                                                   "setfps",
                                                                   "setbitrate",
                                                                   "setresolution",
                                                                   "downvision",
                                                                   "ap",
                                                                   "wifi",
                                                                   "multiwifi",
                                                                   "wifisetchannel",
                                                                   "EXT",
                                                                   "battery?",
                                                                   "speed?",
                                                                   "time?",
                                                                   "wifi?",
                                                                   "sdk?",
                                                                   "sn?",
                                                                   "height?",
                                                                   "temp?",
                                                                   "attitude?",
                                                                   "baro?",
                                                                   "acceleration?",
                                                                   "tof?",
                                                                   "hardware?",
                                                                   "active?",
                                                                   "wifiversion?",
                                                                   "ssid?",
                                                                   "ap?"});

}  // namespace

std::string_view call_word(std::string_view command) {
  constexpr std::string_view blanks(" \t\r\n\0", 5);
  const std::size_t begin = command.find_first_not_of(blanks);
  if (begin == std::string_view::npos) return {};
  command.remove_prefix(begin);
  return command.substr(0, command.find_first_of(blanks));
}

std::optional<Answered> how_answered(std::string_view word) {
  const auto is_in = [word](const auto& words) { return std::ranges::find(words, word) != words.end(); };
  if (is_in(unanswered)) return Answered::never;
  if (is_in(moves)) return Answered::at_end;
  if (is_in(answered_at_once)) return Answered::at_once;
  return std::nullopt;
}

bool breaks_off(std::string_view word) { return word == "stop" || word == "land" || word == "emergency"; }

bool is_refusal(std::string_view answer) {
  constexpr auto beginnings = std::to_array<std::string_view>({"error", "out of range", "unknown command"});
  return std::any_of(beginnings.begin(), beginnings.end(),
                     [&](std::string_view beginning) { return answer.starts_with(beginning); });
}

bool OpenCalls::command(TimeNs now, std::string_view bytes, std::uint64_t tag) {
  const std::string_view word = call_word(bytes).substr(0, max_word_bytes);
  const Answered answered = how_answered(word).value_or(Answered::at_once);  // an unknown one is refused
  if (word.empty() || answered == Answered::never) return false;
  const auto again = std::find_if(calls_.begin(), calls_.end(), [&](const Call& call) { return call.word == word; });
  if (again != calls_.end()) {
    again->since_ns = now;
    again->tag = tag;
    return true;
  }
  if (calls_.size() == max_open) calls_.pop_front();
  calls_.push_back({std::string(word), answered == Answered::at_once, now, tag});
  return true;
}

std::optional<OpenCalls::Call> OpenCalls::match(TimeNs now, std::string_view answer) {
  std::erase_if(calls_, [&](const Call& call) { return now - call.since_ns > answer_lost_ns; });
  const auto quick = std::find_if(calls_.begin(), calls_.end(), [](const Call& call) { return call.at_once; });
  const auto move = std::find_if(calls_.begin(), calls_.end(), [](const Call& call) { return !call.at_once; });
  const bool broken_off =
      move != calls_.end() && is_refusal(answer) &&
      std::any_of(std::next(move), calls_.end(), [](const Call& call) { return breaks_off(call.word); });
  const auto whose = broken_off || quick == calls_.end() ? move : quick;
  if (whose == calls_.end()) return std::nullopt;
  Call call = std::move(*whose);
  calls_.erase(whose);
  return call;
}

}  // namespace ledgerline::hil
