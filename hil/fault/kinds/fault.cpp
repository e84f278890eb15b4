#include "hil/fault/kinds/fault.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>

#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

using Words = std::vector<std::string_view>;

Error wrong(std::string_view text, std::string_view what) { return Error{fmt::format("\"{}\": {}", text, what)}; }

bool is_open(std::string_view of_form) { return std::isupper(static_cast<unsigned char>(of_form[0])) != 0; }

bool is_one_of(std::string_view word, std::string_view choices) {
  for (std::size_t begin = 0; begin <= choices.size();) {
    const std::size_t end = std::min(choices.find('|', begin), choices.size());
    if (choices.substr(begin, end - begin) == word) return true;
    begin = end + 1;
  }
  return false;
}

/// How well words fit a form.
struct Fit {
  std::size_t fixed = 0;  ///< words that stand as they are, from the beginning on
  bool all_fixed = true;  ///< every one of the form's
  bool whole = false;     ///< and there are as many words as it has
};

Fit fit_of(const Words& words, const Words& form) {
  Fit fit;
  for (std::size_t i = 0; i < form.size() && fit.all_fixed; ++i) {
    if (is_open(form[i])) continue;
    fit.all_fixed = i < words.size() && is_one_of(words[i], form[i]);
    if (fit.all_fixed) ++fit.fixed;
  }
  const bool open_end = form.back().ends_with("...");
  fit.whole = fit.all_fixed && (open_end ? words.size() + 1 >= form.size() : words.size() == form.size());
  return fit;
}

FaultKind::ParsedWords said_in(const std::string& text, const FaultKind& kind) {
  const Words words = words_of(text), form = words_of(kind.form);
  FaultKind::ParsedWords said{text, {}, {}, {}};
  for (std::size_t i = 0; i < form.size(); ++i) {
    if (form[i].ends_with("...")) {
      said.rest = fmt::format("{}", fmt::join(words.begin() + static_cast<std::ptrdiff_t>(i), words.end(), " "));
    } else if (form[i] == "NAME") {
      said.drone = words[i] == "*" ? "" : words[i];
    } else if (is_open(form[i]) || form[i].find('|') != std::string_view::npos) {
      said.words.push_back(words[i]);
    }
  }
  return said;
}

}  // namespace

std::vector<const FaultKind*> fault_kinds() {
  std::vector<const FaultKind*> all;
  for (const auto& table :
       {drone_faults(), sdk_faults(), sensing_faults(), ledger_faults(), process_faults(), machine_faults()}) {
    for (const FaultKind& kind : table) all.push_back(&kind);
  }
  return all;
}

Result<const FaultKind*> kind_of(std::string_view text, bool real) {
  const Words words = words_of(text);
  std::pair<bool, std::size_t>
      best;  // of all kinds: all its fixed words are there; how many of them, from the beginning
  std::vector<const FaultKind*> nearest;
  for (const FaultKind* kind : fault_kinds()) {
    const Fit fit = fit_of(words, words_of(kind->form));
    const std::pair rank{fit.all_fixed, fit.fixed};
    if (fit.fixed == 0 || rank < best) continue;
    if (rank > best) nearest.clear();
    best = rank;
    nearest.push_back(kind);
  }
  if (nearest.empty())
    return wrong(text,
                 "must begin with drone, sdk, sensor, mocap, pads, wind, ledger, agent, link, ground, clock, operator, "
                 "supervisor or outsider");
  if (!real && nearest.front()->real_only)
    return wrong(text, fmt::format("{} is not there in simulated time: such a fault needs the real processes (--real)",
                                   words[0]));
  std::string forms;
  for (const FaultKind* kind : nearest) {
    if (fit_of(words, words_of(kind->form)).whole) return kind;
    forms += fmt::format("{}`{}`", forms.empty() ? "" : ", ", kind->form);
  }
  return wrong(text, "must be " + forms);
}

Result<Fault> parse_fault(std::string_view text, std::string_view at, std::string_view duration, bool real) {
  Fault fault;
  fault.text = fmt::format("{}", fmt::join(words_of(text), " "));
  if (fault.text.empty()) return Error{"a fault must say where and what, as in \"drone tello1 to delay 200ms\""};
  const auto kind = kind_of(fault.text, real);
  if (!kind) return kind.error();
  const FaultKind::ParsedWords said = said_in(fault.text, **kind);
  auto acts = (*kind)->make(said);
  if (!acts) return wrong(fault.text, acts.error().what);
  fault.drone = said.drone;
  fault.acts = std::move(*acts);
  if (!at.empty()) {
    auto trigger = parse_trigger(at);
    if (!trigger) return trigger.error();
    fault.trigger = *trigger;
    fault.at = at;
  }
  if (!duration.empty()) {
    const auto time = parse_time(duration);
    if (!time) return time.error();
    if (*time <= 0) return wrong(duration, "a fault lasts longer than nothing; leave `for` out for one to the end");
    if (fault.acts.momentary) return wrong(fault.text, "happens at one moment: leave `for` out");
    fault.for_ns = *time;
  }
  return fault;
}

std::string never_text(const Fault& fault) { return fmt::format("\"{}\" at {} never began", fault.text, fault.at); }

}  // namespace ledgerline::hil
