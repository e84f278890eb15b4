#include "hil/netem/sdk/calls.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>

namespace ledgerline::hil {
namespace {

constexpr std::pair<std::string_view, Answered> calls[] = {
    {"rc", Answered::never},
    {"reboot", Answered::never},
    {"takeoff", Answered::at_end},
    {"land", Answered::at_end},
    {"up", Answered::at_end},
    {"down", Answered::at_end},
    {"left", Answered::at_end},
    {"right", Answered::at_end},
    {"forward", Answered::at_end},
    {"back", Answered::at_end},
    {"cw", Answered::at_end},
    {"ccw", Answered::at_end},
    {"flip", Answered::at_end},
    {"go", Answered::at_end},
    {"curve", Answered::at_end},
    {"jump", Answered::at_end},
    {"command", Answered::at_once},
    {"emergency", Answered::at_once},
    {"stop", Answered::at_once},
    {"keepalive", Answered::at_once},
    {"speed", Answered::at_once},
    {"mon", Answered::at_once},
    {"moff", Answered::at_once},
    {"mdirection", Answered::at_once},
    {"streamon", Answered::at_once},
    {"streamoff", Answered::at_once},
    {"motoron", Answered::at_once},
    {"motoroff", Answered::at_once},
    {"throwfly", Answered::at_once},
    {"port", Answered::at_once},
    {"setfps", Answered::at_once},
    {"setbitrate", Answered::at_once},
    {"setresolution", Answered::at_once},
    {"downvision", Answered::at_once},
    {"ap", Answered::at_once},
    {"wifi", Answered::at_once},
    {"multiwifi", Answered::at_once},
    {"wifisetchannel", Answered::at_once},
    {"EXT", Answered::at_once},
};

constexpr auto questions = std::to_array<std::string_view>(
    {"battery?", "speed?", "time?", "wifi?", "sdk?", "sn?", "height?", "temp?", "attitude?", "baro?", "acceleration?",
     "tof?", "hardware?", "active?", "wifiversion?", "ssid?", "ap?"});

}  // namespace

std::string_view call_word(std::string_view command) {
  constexpr std::string_view blanks(" \t\r\n\0", 5);
  const std::size_t begin = command.find_first_not_of(blanks);
  if (begin == std::string_view::npos) return {};
  command.remove_prefix(begin);
  return command.substr(0, command.find_first_of(blanks));
}

std::optional<Answered> how_answered(std::string_view word) {
  const auto* call = std::find_if(std::begin(calls), std::end(calls), [&](const auto& c) { return c.first == word; });
  if (call != std::end(calls)) return call->second;
  if (std::find(questions.begin(), questions.end(), word) != questions.end()) return Answered::at_once;
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

std::optional<OpenCalls::Call> OpenCalls::take(TimeNs now, std::string_view answer) {
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
