#include "hil/netem/sdk/sdk_fault.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "common/base/printable.hpp"
#include "hil/netem/distribution.hpp"
#include "hil/netem/sdk/calls.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

using Kind = SdkFault::Kind;

constexpr std::array<std::string_view, sdk_fault_kinds> kind_names{"late",  "wrong",   "garbage", "missing", "twice",
                                                                   "other", "shifted", "torn",    "stale",   "other"};

constexpr std::string_view forms =
    "must be `answers late TIME [SHARE] [to COMMAND]`, `answers wrong|garbage|missing|other|shifted [SHARE] [to "
    "COMMAND]`, `answers twice [TIME] [SHARE] [to COMMAND]` or `states torn|stale|other [SHARE]`, with a TIME such as "
    "300ms, a SHARE such as 30% and a COMMAND of the SDK, or * for every one";

Error wrong(std::string_view text, std::string_view why) {
  return Error{fmt::format("\"{}\": {}", printable(text, 100), why)};
}

Result<std::string> command_in(std::string_view word) {
  if (word == "*") return std::string();
  const auto answered = how_answered(word);
  if (!answered)
    return wrong(word,
                 "is no command of the SDK: takeoff, land, command, emergency, forward, battery? ..., or * for every "
                 "one");
  if (*answered == Answered::never) return wrong(word, "has no answer, so nothing can be wrong with it");
  return std::string(word);
}

}  // namespace

std::string_view name_of(SdkFault::Kind kind) { return kind_names[static_cast<std::size_t>(kind)]; }

Result<SdkFault> parse_sdk_fault(std::string_view text) {
  const auto words = words_of(text);
  if (words.size() < 2 || (words[0] != "answers" && words[0] != "states")) return wrong(text, forms);
  const bool states = words[0] == "states";
  SdkFault fault;
  const auto* const begin = kind_names.begin() + (states ? static_cast<int>(Kind::torn) : 0);
  const auto* const end = states ? kind_names.end() : kind_names.begin() + static_cast<int>(Kind::torn);
  const auto* const named = std::find(begin, end, words[1]);
  if (named == end) return wrong(text, forms);
  fault.kind = static_cast<Kind>(named - kind_names.begin());
  const bool may_have_time = fault.kind == Kind::late || fault.kind == Kind::twice;
  bool time_there = false;
  std::size_t i = 2;
  if (i < words.size() && may_have_time && !words[i].ends_with('%') && words[i] != "to") {
    const auto time = parse_time(words[i]);
    if (!time) return wrong(text, time.error().what);
    fault.time_ns = *time;
    time_there = true;
    ++i;
  }
  if (fault.kind == Kind::late && (!time_there || fault.time_ns == 0))
    return wrong(text, "late must be followed by a TIME of more than nothing, such as 300ms");
  if (i < words.size() && words[i].ends_with('%')) {
    const auto share = parse_number(words[i].substr(0, words[i].size() - 1));
    if (!share || *share <= 0 || *share > 100)
      return wrong(text, "a SHARE is more than 0% and at most 100%, such as 30%");
    fault.share = *share / 100;
    ++i;
  }
  if (!states && i + 1 < words.size() && words[i] == "to") {
    auto command = command_in(words[i + 1]);
    if (!command) return command.error();
    fault.command = std::move(*command);
    i += 2;
  }
  if (i != words.size()) return wrong(text, forms);
  return fault;
}

std::string text_of(const SdkFault& fault) {
  std::string text = fmt::format("{} {}", of_states(fault.kind) ? "states" : "answers", name_of(fault.kind));
  if (fault.kind == Kind::late || (fault.kind == Kind::twice && fault.time_ns > 0))
    text += " " + time_text(fault.time_ns);
  if (fault.share < 1) text += fmt::format(" {}%", fault.share * 100);
  if (!fault.command.empty()) text += " to " + fault.command;
  return text;
}

}  // namespace ledgerline::hil
