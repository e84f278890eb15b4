#include "hil/netem/sdk/open_calls.hpp"

#include <algorithm>
#include <iterator>

#include "hil/netem/sdk/calls.hpp"

namespace ledgerline::hil {

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
