#include "tools/station/shell/signing.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include "common/base/file.hpp"
#include "common/program/program.hpp"
#include "common/rt/clock.hpp"
#include "ground/service/operators/calls.hpp"
#include "tools/station/core/show.hpp"

namespace ledgerline::station {
namespace {

using Kind = ground::service::OperatorCall::Kind;

constexpr TimeNs outcome_limit_ns = 30 * ns_per_s;  // a ledger that is slow, and its client's own attempts
constexpr TimeNs counted_limit_ns = 5 * ns_per_s;   // who signs a second time is not counted again
constexpr TimeNs ask_every_ns = 100 * ns_per_ms;
constexpr TimeNs board_gap_ns = 700 * ns_per_ms;  // the drones' table may be half a second old

constexpr std::array<std::pair<std::string_view, Kind>, 6> kinds{{{"acquire", Kind::acquire},
                                                                  {"release", Kind::release},
                                                                  {"request", Kind::request},
                                                                  {"clear_stop", Kind::clear_stop},
                                                                  {"hand_over", Kind::hand_over},
                                                                  {"deny", Kind::deny}}};

auto row_of(const std::string& verb) {
  return std::find_if(kinds.begin(), kinds.end(), [&](const auto& row) { return row.first == verb; });
}

Result<std::vector<ShownEvent>> events_behind(Station& station, std::uint64_t number) {
  const auto body = station.request(events_since(number));
  if (!body) return body.error();
  return events_from(*body);
}

Result<Approvals> approvals_of(Station& station, const std::string& id) {
  const auto body = station.request({.target = "missions/" + id});
  if (!body) return body.error();
  return approvals_from(*body);
}

}  // namespace

Result<Session> open_session(Station& station, const Target& target, const std::string& name,
                             const std::string& pass_phrase) {
  if (target.session_file.empty())
    return Error{"there is no place for the session: give --session-file, or set XDG_RUNTIME_DIR or HOME"};
  const auto body = station.request(sign_in(name, pass_phrase));
  if (!body) return body.error();
  auto session = session_from(*body);
  if (!session) return session;
  if (auto written = replace_file(target.session_file, session->token + "\n", 0600); !written) return written.error();
  return session;
}

Status close_session(Station& station, const Target& target) {
  const auto body = station.request({.method = "DELETE", .target = "session", .anybodys = false});
  if (!body) return body.error();
  if (std::remove(target.session_file.c_str()) != 0)
    return Error{fmt::format("signed out, but {} stays: {}", target.session_file, std::strerror(errno))};
  return done;
}

bool is_signed_call(const std::string& verb) { return row_of(verb) != kinds.end(); }

Status call_and_wait(Station& station, const std::string& drone, const std::string& verb, const std::string& body) {
  const auto operators = station.request({.target = "operators"});
  if (!operators) return operators.error();
  const auto name = signed_in_as(*operators);
  if (!name) return name.error();
  if (verb == "clear_stop" && nobody_signs_in(*operators)) {
    const auto newest = newest_event(station);
    if (!newest) return newest.error();
    if (const auto taken = station.request(drone_request(drone, verb, body)); !taken) return taken.error();
    return wait_or_hear(station, {drone}, "its stop is not cleared", *newest, drone + ": clear_stop", outcome_limit_ns,
                        [&](std::string_view answer) { return is_cleared(answer, drone); });
  }
  const auto newest = newest_event(station);
  if (!newest) return newest.error();
  std::uint64_t number = *newest;
  if (const auto taken = station.request(drone_request(drone, verb, body)); !taken) return taken.error();
  const std::string said = fmt::format("{}: {}", *name, ground::service::words_of({.kind = row_of(verb)->second}));
  for (const TimeNs until_ns = monotonic_ns() + outcome_limit_ns; monotonic_ns() < until_ns; rest(ask_every_ns)) {
    const auto events = events_behind(station, number);
    if (!events) return events.error();
    for (const ShownEvent& event : *events) {
      number = event.number;
      if (event.drone != drone || !event.text.starts_with(said)) continue;
      return event.text == said ? Status(done) : Status(Error{of_drone(drone, event.text)});
    }
  }
  return Error{fmt::format("{}: {}: nothing came of it within 30 s", drone, said)};
}

Status wait_until(Station& station, const std::string& target, const std::string& what, TimeNs limit_ns,
                  const std::function<Result<bool>(std::string_view body)>& is_there) {
  catch_stop_signals();
  rest(board_gap_ns);  // what is from before the request says nothing
  for (const TimeNs until_ns = monotonic_ns() + limit_ns; monotonic_ns() < until_ns && !stop_requested;
       rest(ask_every_ns)) {
    const auto body = station.request({.target = target});
    if (!body) return body.error();
    const auto there = is_there(*body);
    if (!there) return there.error();
    if (*there) return done;
  }
  if (stop_requested) return Error{what + ": no longer waited for"};
  return Error{fmt::format("{}: not after {:.0f} s; `ledgerline alarms` may say why", what, to_seconds(limit_ns))};
}

Result<std::uint64_t> newest_event(Station& station) {
  const auto events = events_behind(station, 0);
  if (!events) return events.error();
  return events->empty() ? 0 : events->back().number;
}

Status wait_or_hear(Station& station, const std::vector<std::string>& names, const std::string& refusal,
                    std::uint64_t number, const std::string& what, TimeNs limit_ns,
                    const std::function<Result<bool>(std::string_view drones)>& is_there) {
  return wait_until(station, "drones", what, limit_ns, [&](std::string_view drones) -> Result<bool> {
    const auto events = events_behind(station, number);
    if (!events) return events.error();
    for (const ShownEvent& event : *events) {
      number = event.number;
      const bool is_asked = names.empty() || std::ranges::find(names, event.drone) != names.end();
      if (is_asked && event.text.find(refusal) != std::string::npos) return Error{of_drone(event.drone, event.text)};
    }
    return is_there(drones);
  });
}

Result<std::string> approve_and_wait(Station& station, const std::string& id) {
  const auto before = approvals_of(station, id);
  if (!before) return before.error();
  const auto newest = newest_event(station);
  if (!newest) return newest.error();
  std::uint64_t number = *newest;
  if (const auto taken = station.request(mission_request(id, "approve")); !taken) return taken.error();
  std::string refusal;  // of who has approved before
  const std::string said = "approve mission " + before->name, refused = said + ": refused";
  TimeNs until_ns = monotonic_ns() + outcome_limit_ns;
  bool is_signed = false;
  for (; monotonic_ns() < until_ns; rest(ask_every_ns)) {
    const auto now = approvals_of(station, id);
    if (!now) return now.error();
    if (now->signers.size() > before->signers.size()) return std::string("done");
    if (!refusal.empty() && counts_already(*now, refusal)) return std::string("approved before, and that still counts");
    const auto events = events_behind(station, number);
    if (!events) return events.error();
    for (const ShownEvent& event : *events) {
      number = event.number;
      if (event.level != "info" && (event.text.find(said) != std::string::npos || event.text.starts_with(refused))) {
        if (!is_anchored_already(event.text)) return Error{event.text};
        refusal = event.text;  // the approvals of a mission that was just added may not have been read yet
        until_ns = monotonic_ns() + counted_limit_ns;
      }
      if (is_signed || !event.text.ends_with(said)) continue;
      is_signed = true;
      until_ns = monotonic_ns() + counted_limit_ns;
    }
  }
  if (!refusal.empty()) return Error{refusal};
  if (is_signed) return std::string("done");
  return Error{fmt::format("{}: nothing came of it within 30 s", said)};
}

}  // namespace ledgerline::station
