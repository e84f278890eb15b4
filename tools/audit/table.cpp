#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <ctime>

#include "common/access/identity.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/names.hpp"
#include "tools/audit/chain_audit.hpp"

namespace ledgerline::audit {
namespace {

constexpr std::size_t max_lines = 6;  // of a drone's lists: the page and --json have them whole
constexpr std::size_t max_drones = 8;
constexpr std::size_t max_findings = 20;
constexpr std::array<std::string_view, 5> stop_words{"cut", contract::stop, contract::clear_stop, contract::evict,
                                                     contract::apply_stops};
constexpr std::array<std::string_view, 4> other_kept_words{"take-off", "landing", contract::grant, contract::hand_over};

std::string time_text(TimeNs time_ns) {
  if (time_ns <= 0) return "at no time";
  const std::time_t seconds = time_ns / ns_per_s;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S", &utc);
  return text;
}

std::string where(const Moment& moment) { return fmt::format("block {}, {}", moment.block, time_text(moment.time_ns)); }

std::string codes_text(const std::map<int, std::uint64_t>& codes) {
  std::string text;
  for (const auto& [code, count] : codes) text += fmt::format(", {} {}", count, code_name(code));
  return text;
}

/// How many there are beside those that are shown, and where they are; nothing where that is all.
std::string rest_text(std::uint64_t count, std::size_t shown, std::size_t listed) {
  if (count <= shown) return "";
  return fmt::format("    and {} more: --json or --html has {}\n", count - shown,
                     count == listed ? "all" : fmt::format("{} of all {}", listed, count));
}

/// The first lines, and how many there are beside them.
template <typename List, typename Line>
std::string some(const List& list, std::uint64_t count, const Line& line) {
  std::string text;
  std::size_t shown = 0;
  for (const auto& one : list) {
    if (shown == max_lines) break;
    text += "    " + line(one) + "\n";
    ++shown;
  }
  return text + rest_text(count, shown, list.size());
}

std::string event_line(const Event& e) {
  return fmt::format("{}{}{} by {}, {}", e.what, e.object.empty() ? "" : " ", e.object, e.who, where(e.when));
}
std::string event_line_with_id(const Event& e) { return event_line(e) + ", transaction " + e.when.tx_id; }

/// Who stopped a drone, who ended that, who took its lease away: of drones that never flew, too.
bool is_stop(const Event& e) { return std::ranges::find(stop_words, e.what) != stop_words.end(); }

/// What is never left out.
bool is_kept(const Event& e) {
  return is_stop(e) || std::ranges::find(other_kept_words, e.what) != other_kept_words.end();
}

/// In the chain's order, as many as fit: what is kept in any case, enrolments last.
std::string events_text(const FirstOnes<Event>& events, std::size_t max) {
  const auto rank = [](const Event* e) { return is_kept(*e) ? 0 : e->what == contract::enroll ? 2 : 1; };
  std::vector<const Event*> shown;
  for (const Event& event : events.all()) shown.push_back(&event);
  std::ranges::stable_sort(shown, {}, rank);
  const auto kept = static_cast<std::size_t>(std::ranges::count(shown, 0, rank));
  shown.resize(std::min(shown.size(), std::max(kept, max)));
  std::ranges::sort(shown);
  std::string text;
  for (const Event* event : shown)
    text += fmt::format("    {}\n",
                        is_stop(*event) || event->what == "landing" ? event_line_with_id(*event) : event_line(*event));
  return text + rest_text(events.count(), shown.size(), events.all().size());
}

std::string anchors_text(const FirstOnes<Event>& anchors, const TimeSpan& span) {
  std::vector<Event> before, within;
  for (const Event& anchor : anchors.all()) (anchor.when.time_ns < span.from_ns ? before : within).push_back(anchor);
  std::string text;
  if (!before.empty())
    text += "  anchored before, and in force in that time:\n" + some(before, before.size(), event_line_with_id);
  if (anchors.count() > before.size())
    text += "  anchored:\n" + some(within, anchors.count() - before.size(), event_line_with_id);
  return text;
}

std::string holder_line(const Tenure& t) {
  const std::string until = t.to ? fmt::format("to {} ({})", where(*t.to), t.ended_by) : "and holds it still";
  const std::string delegate = t.delegate.empty() ? "" : fmt::format(", commanded by {}", t.delegate);
  return fmt::format("held by {}{}, epoch {}, priority {}, from {}, {}", t.who, delegate, t.epoch, t.priority,
                     where(t.from), until);
}

std::string drone_text(const std::string& drone_name, const DroneReport& drone) {
  std::string text = fmt::format("\n  {}: {} states, {} poses\n", drone_name, drone.states, drone.path.count());
  if (drone.record) text += fmt::format("    on host {}\n", text_of(to_name(drone.record->owner())));
  text += some(drone.holders.all(), drone.holders.count(), holder_line);
  text += some(drone.commands, drone.commands.size(), [](const auto& entry) {
    const Commands& c = entry.second;
    return fmt::format("commands of {}: {} valid{}; {} to {}", entry.first, c.valid, codes_text(c.invalid),
                       where(c.first), where(c.last));
  });
  text += events_text(drone.events, max_lines);
  if (std::ranges::any_of(drone.events.all(), [](const Event& e) { return e.who.ends_with("'s lease"); }))
    text += "    under a lease: sent by ground; who asked it to, if only by a stop, is in ground's log\n";
  text += some(drone.transitions.all(), drone.transitions.count(), [](const Change& c) {
    const Transition& t = c.transition;
    return fmt::format("failsafe {}: {}, {}, {}; {}", t.number, name(t.phase), name(t.mode), name(t.cause),
                       where(c.when));
  });
  if (drone.transitions_missing > 0)
    text += fmt::format("    {} of its failsafe's transitions are not in the chain\n", drone.transitions_missing);
  if (drone.path.count() > 0)
    text +=
        fmt::format("    flown: x {:.2f} to {:.2f} m, y {:.2f} to {:.2f} m, z {:.2f} to {:.2f} m\n", drone.lowest_m[0],
                    drone.highest_m[0], drone.lowest_m[1], drone.highest_m[1], drone.lowest_m[2], drone.highest_m[2]);
  const Quantiles q = drone.two_way.quantiles_ms();
  if (q.count > 0)
    text +=
        fmt::format("    two-way latency by the drone host's clock: median {:.1f} ms, p95 {:.1f}, max {:.1f}, of {}\n",
                    q.median, q.p95, q.max, q.count);
  return text;
}

std::string refusals_text(const ChainReport& report, const std::string& counted) {
  if (report.refusals().empty()) return "";
  std::vector<std::pair<ChainReport::RefusalKey, Refusals>> all(report.refusals().begin(), report.refusals().end());
  std::stable_sort(all.begin(), all.end(),
                   [](const auto& a, const auto& b) { return a.second.count > b.second.count; });
  return fmt::format("\n  invalid transactions{}\n", counted) +
         some(all, all.size() + report.refusals_left_out(), [](const auto& entry) {
           const auto& [key, r] = entry;
           return fmt::format("{} {} of {}: {} ({}); first in {}", r.count,
                              key.function.empty() ? "calls" : key.function, key.who, code_name(key.code), r.why,
                              where(r.first));
         });
}

std::string findings_text(const ChainAudit& audit) {
  std::string text = "\n";
  const auto& findings = audit.findings();
  for (std::size_t i = 0; i < std::min(findings.size(), max_findings); ++i)
    text += fmt::format("  found: {}\n", to_text(findings[i]));
  if (audit.counts().findings > max_findings)
    text += fmt::format("  and {} findings more, which may follow from the first ones\n",
                        audit.counts().findings - max_findings);
  return text + verdict(audit) + "\n";
}

}  // namespace

std::string to_table(const ChainAudit& audit, const AuditRequest& asked) {
  const Counts& c = audit.counts();
  const ChainReport& report = audit.report();
  std::string text = fmt::format("channel {}, from {}: {} blocks, {} of them configurations; newest {}\n",
                                 asked.channel, asked.source, c.blocks, c.config_blocks, audit.newest_hash());
  text += asked.anchor.empty() ? "  NO TRUST ANCHOR: the first block was taken as it is, so the author of this chain "
                                 "may have made up all of it\n"
                               : fmt::format("  trust anchor: {}\n", asked.anchor);
  if (!asked.drones.empty()) text += fmt::format("  reported: {} alone\n", fmt::join(asked.drones, ", "));
  if (!asked.span.is_from_the_start()) text += fmt::format("  reported from {} on\n", time_text(asked.span.from_ns));
  if (!asked.span.is_to_the_end()) text += fmt::format("  reported to {}\n", time_text(asked.span.to_ns));
  const std::string counted = asked.counted().empty() ? "" : " " + asked.counted();
  text += fmt::format("  {}{} transactions with {} endorsements: {} valid{}\n",
                      counted.empty() ? "" : "the whole chain: ", c.transactions, c.endorsements, c.valid,
                      codes_text(c.invalid));
  if (report.first_ns() > 0)
    text +=
        fmt::format("  {} to {} (UTC, as clients say)\n", time_text(report.first_ns()), time_text(report.last_ns()));
  if (c.without_flags > 0) text += fmt::format("  {} blocks have no flags to compare with\n", c.without_flags);
  std::string functions;
  for (const auto& [name, count] : report.functions()) {
    const bool of_others = name.ends_with(':');
    functions += fmt::format("{} {} {}{}", functions.empty() ? "" : ",", count, of_others ? "of contract " : "",
                             of_others ? name.substr(0, name.size() - 1) : name);
  }
  if (!functions.empty()) text += fmt::format("  valid{}:{}\n", counted, functions);
  text += some(report.roles().all(), report.roles().count(), event_line);
  text += anchors_text(report.anchors(), asked.span);
  const std::string never =
      asked.span.is_from_the_start() && asked.span.is_to_the_end() ? "never flew" : "did not fly in that time";
  std::size_t shown = 0, quiet = 0, beyond = 0;
  for (const auto& [name, drone] : report.drones()) {
    if (!asked.reports(name)) continue;
    const bool flew = drone.states > 0 || !drone.commands.empty();
    const bool stopped = std::ranges::any_of(drone.events.all(), is_stop);
    if (!flew && !stopped && drone.holders.count() == 0 && asked.drones.empty()) {
      ++quiet;
    } else if (shown < max_drones || !asked.drones.empty()) {
      text += drone_text(name, drone) + (flew ? "" : fmt::format("    enrolled, but {}\n", never));
      ++shown;
    } else {
      ++beyond;
      if (std::ranges::any_of(drone.events.all(), is_kept))
        text += fmt::format("\n  {}:\n", name) + events_text(drone.events, 0);
    }
  }
  if (quiet > 0) text += fmt::format("\n  {} enrolled drones {}\n", quiet, never);
  if (beyond > 0) text += fmt::format("\n  {} drones more than fit here: --json or --html has all\n", beyond);
  return text + refusals_text(report, counted) + findings_text(audit);
}

}  // namespace ledgerline::audit
