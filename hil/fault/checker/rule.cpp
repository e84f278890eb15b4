#include "hil/fault/checker/rule.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>

#include "common/base/enum_count.hpp"
#include "common/base/nearest_word.hpp"
#include "common/msg/names.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

using Takes = RuleKind::Takes;

/// What stands for {} in help.
constexpr std::array<std::string_view, 7> amount_examples{"", "2 s", "0.4 m", "1.5 m/s", "70", "MODE|CAUSE", "COMMAND"};
static_assert(amount_examples.size() == enum_count<Takes>);

std::optional<FailsafeMode> mode_of(std::string_view word) {
  for (const FailsafeMode mode : {FailsafeMode::hold, FailsafeMode::brake, FailsafeMode::land, FailsafeMode::cut}) {
    if (name(mode) == word) return mode;
  }
  return std::nullopt;
}

std::optional<FailsafeCause> cause_of(std::string_view text) {
  for (std::size_t i = 1; i < enum_count<FailsafeCause>; ++i) {
    const auto cause = static_cast<FailsafeCause>(i);
    std::string words(name(cause));
    std::replace(words.begin(), words.end(), '_', ' ');
    if (words == text) return cause;
  }
  return std::nullopt;
}

bool read_amount(Rule& rule, std::string_view text, Amount::Unit unit) {
  const auto amount = parse_amount(text);
  if (amount) rule.amount = amount->value;
  return amount && amount->unit == unit;
}

/// Whether `text` can stand for {}; it is in the rule then.
bool read_value(Rule& rule, Takes what, std::string_view text) {
  constexpr std::array<std::string_view, 4> commands{"command", "takeoff", "land", "emergency"};
  switch (what) {
    case Takes::nothing:
      return text.empty();
    case Takes::time:
      return read_amount(rule, text, Amount::Unit::time);
    case Takes::metres:
      return read_amount(rule, text, Amount::Unit::metres);
    case Takes::speed:
      return read_amount(rule, text, Amount::Unit::speed);
    case Takes::number: {
      const auto number = parse_number(text);
      rule.amount = number.value_or(0);
      return number.has_value();
    }
    case Takes::mode_or_cause:
      rule.mode = mode_of(text);
      rule.cause = cause_of(text);
      return rule.mode || rule.cause;
    case Takes::command:
      rule.command = text;
      return std::find(commands.begin(), commands.end(), text) != commands.end();
  }
  return false;
}

}  // namespace

std::optional<Amount> parse_amount(std::string_view text) {
  text = trimmed(text);
  const std::size_t end = text.find_first_not_of("0123456789.");
  if (end == 0 || end == std::string_view::npos) return std::nullopt;
  const auto value = parse_number(text.substr(0, end));
  const std::string_view unit = trimmed(text.substr(end));
  if (!value) return std::nullopt;
  if (unit == "ms") return Amount{*value / 1000, Amount::Unit::time};
  if (unit == "s") return Amount{*value, Amount::Unit::time};
  if (unit == "m") return Amount{*value, Amount::Unit::metres};
  if (unit == "m/s") return Amount{*value, Amount::Unit::speed};
  return std::nullopt;
}

std::string form_of(const RuleKind& kind) {
  std::string form(kind.form);
  if (const auto at = form.find("{}"); at != std::string::npos)
    form.replace(at, 2, amount_examples.at(static_cast<std::size_t>(kind.takes)));
  return form;
}

std::string rule_help() {
  std::string help;
  for (const RuleKind& kind : rule_kinds()) help += fmt::format("  {:<40} {}\n", form_of(kind), kind.help);
  return help;
}

Result<Rule> parse_rule(std::string_view sentence) {
  Rule rule;
  rule.text = fmt::format("{}", fmt::join(words_of(sentence), " "));
  for (const RuleKind& kind : rule_kinds()) {
    const std::string_view text = rule.text;
    const std::size_t open = std::min(kind.form.find("{}"), kind.form.size());
    const std::string_view before = kind.form.substr(0, open);
    const std::string_view after = kind.form.substr(std::min(open + 2, kind.form.size()));
    if (text.size() < before.size() + after.size() || !text.starts_with(before) || !text.ends_with(after)) continue;
    if (!read_value(rule, kind.takes, text.substr(before.size(), text.size() - before.size() - after.size()))) continue;
    rule.kind = &kind;
    return rule;
  }
  std::vector<std::string> forms;
  for (const RuleKind& kind : rule_kinds()) forms.push_back(form_of(kind));
  const std::string near = nearest_word(rule.text, forms);
  return Error{fmt::format("\"{}\" is no rule{} (`ledgerline fault list rules`)", rule.text,
                           near.empty() ? "" : fmt::format(": did you mean \"{}\"?", near))};
}

void Verdict::broke(TimeNs now, std::string seen) {
  if (!held) return;
  held = false;
  broken_ns = now;
  what = std::move(seen);
}

Verdict always(std::string_view text) {
  Verdict verdict;
  verdict.rule.text = text;
  verdict.rule.always = true;
  return verdict;
}

bool RuleState::all_done() const { return std::find(done.begin(), done.end(), false) == done.end(); }

}  // namespace ledgerline::hil
