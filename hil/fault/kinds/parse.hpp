#pragma once
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hil/fault/kinds/fault.hpp"
#include "hil/netem/text_parse.hpp"

// What the rows of the tables read from words, and the reasons that several of them have.
namespace ledgerline::hil {

inline constexpr std::string_view inside_the_simulation = "it is inside of the simulation: simulated time alone has it";
inline constexpr std::string_view nobody_real = "no real peer or operator does this: simulated time alone has it";

inline Status allow_if(bool allowed, std::string_view why_not) {
  if (allowed) return done;
  return Error{std::string(why_not)};
}

/// For FaultActs::check_real: it cannot be.
inline auto because(std::string_view reason) {
  return [reason](const Fault&, const RealStack&) { return allow_if(false, reason); };
}

/// Metres, or metres a second.
inline std::optional<std::array<double, 3>> vector_of(const std::vector<std::string_view>& words) {
  std::array<double, 3> v{};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto value = parse_number(words[i]);
    if (!value || std::abs(*value) > 100) return std::nullopt;
    v[i] = *value;
  }
  return v;
}

/// "agent", "ground", "link", or "both": agent and ground.
inline std::vector<Process> processes_of(std::string_view word) {
  if (word == "both") return {Process::agent, Process::ground};
  return {word == "agent" ? Process::agent : word == "link" ? Process::link : Process::ground};
}

/// "delay 200ms, loss 5%": effects that are there.
inline Result<Impairment> effects_in(std::string_view text) {
  Impairment all;
  for (const std::string_view part : split(text, ',')) {
    Impairment effect;
    if (auto applied = apply_effect(part, effect); !applied) return applied.error();
    if (!effect.any()) return Error{"does nothing: a fault ends by its `for`, not by `off` or `clear`"};
    overlay(effect, all);
  }
  return all;
}

}  // namespace ledgerline::hil
