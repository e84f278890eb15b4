#include "hil/netem/recording/lateness.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace ledgerline::hil {
namespace {

constexpr double nominal_s = to_seconds(state_period_ns);
constexpr double period_may_differ = 0.05;
/// Share of a period by which a text may come before its slot and still have it: noise of a schedule that was fitted
/// to less. Half of it, and longer stretches fall apart; twice as much, and texts that are a little late are taken for
/// early ones.
constexpr double early_share = 0.25;
/// States by whose arrivals the schedule is sought first, each of them tried as its beginning; their clock may be wrong
/// by early_share / so many.
constexpr std::size_t first_stretch = 20;

/// State k is said at first_s + k period_s.
struct Schedule {
  double period_s = nominal_s, first_s = 0;
  double at(std::int64_t slot) const { return first_s + static_cast<double>(slot) * period_s; }
};

using Arrivals = std::span<const double>;

/// For each arrival the newest slot that it can have, in their order.
std::vector<std::int64_t> slots_of(Arrivals arrivals, const Schedule& schedule) {
  std::vector<std::int64_t> slots(arrivals.size());
  std::int64_t free = std::numeric_limits<std::int64_t>::max();
  for (std::size_t i = arrivals.size(); i-- > 0;) {
    const double slot = std::floor((arrivals[i] - schedule.first_s) / schedule.period_s + early_share);
    slots[i] = std::min(static_cast<std::int64_t>(slot), free);
    free = slots[i] - 1;
  }
  return slots;
}

/// That which leaves the least lateness of those that begin with one of the arrivals.
Schedule sought(Arrivals arrivals) {
  Schedule best;
  double least = std::numeric_limits<double>::max();
  for (const double first : arrivals) {
    const Schedule tried{nominal_s, first};
    const auto slots = slots_of(arrivals, tried);
    double all = 0;
    for (std::size_t i = 0; i < arrivals.size(); ++i) all += std::abs(arrivals[i] - tried.at(slots[i]));
    if (all < least) {
      least = all;
      best = tried;
    }
  }
  return best;
}

/// The line below all points that is nearest to them: the edge of their lower hull over the middle of the slots.
Schedule fitted(Arrivals arrivals, std::span<const std::int64_t> slots) {
  std::vector<std::size_t> hull;
  const auto x = [&](std::size_t i) { return static_cast<double>(slots[i]); };
  for (std::size_t i = 0; i < slots.size(); ++i) {
    while (hull.size() >= 2) {
      const std::size_t a = hull[hull.size() - 2], b = hull.back();
      const double turn = (x(b) - x(a)) * (arrivals[i] - arrivals[a]) - (arrivals[b] - arrivals[a]) * (x(i) - x(a));
      if (turn > 0) break;
      hull.pop_back();
    }
    hull.push_back(i);
  }
  const double middle = std::accumulate(slots.begin(), slots.end(), 0.0,
                                        [](double sum, std::int64_t p) { return sum + static_cast<double>(p); }) /
                        static_cast<double>(slots.size());
  std::size_t right = 1;
  while (right + 1 < hull.size() && x(hull[right]) < middle) ++right;
  const std::size_t a = hull[right - 1], b = hull[right];
  const double period = (arrivals[b] - arrivals[a]) / (x(b) - x(a));
  return {period, arrivals[a] - x(a) * period};
}

/// The schedule of a stretch without a long pause, and each text's slot in it.
Result<std::pair<Schedule, std::vector<std::int64_t>>> schedule_of(Arrivals arrivals) {
  std::size_t looked_at = std::min(arrivals.size(), first_stretch);
  Schedule schedule = sought(arrivals.first(looked_at));
  std::vector<std::int64_t> slots = slots_of(arrivals.first(looked_at), schedule);
  constexpr std::size_t enough_for_a_line = 3;
  while (arrivals.size() >= enough_for_a_line) {
    schedule = fitted(arrivals.first(looked_at), slots);
    if (std::abs(schedule.period_s / nominal_s - 1) > period_may_differ)
      return Error{fmt::format("states come every {:.1f} ms; a Tello's come every {:.0f} ms", schedule.period_s * 1e3,
                               nominal_s * 1e3)};
    const std::size_t before = looked_at;
    looked_at = std::min(arrivals.size(), looked_at + looked_at / 4);  // by little: what the line's error grows to
    slots = slots_of(arrivals.first(looked_at), schedule);
    if (before == looked_at) break;
  }
  return std::pair(schedule, std::move(slots));
}

/// A text stands for half a period before and behind its place: losses begin and end between two slots, so that they
/// stay as many where the recording is played by somebody whose own clock is a little ahead.
void add(RecordedDelay moment, std::vector<RecordedDelay>& moments) {
  const RecordedDelay before{moment.at_ns - state_period_ns / 2, moment.delay_ns, moment.lost};
  const bool ends_loss = !moment.lost && !moments.empty() && moments.back().lost;
  if (moment.lost) moment = before;
  if (ends_loss && before.at_ns > moments.back().at_ns) moments.push_back(before);
  if (moments.empty() || moment.at_ns > moments.back().at_ns) moments.push_back(moment);
}

/// Adds a stretch; the first one sets `recording_begins_s`, from which moments count. An error where more texts come
/// than the stretch's schedule has slots for.
Status add_stretch(Arrivals arrivals, double& recording_begins_s, MeasuredLink& recording, std::size_t& max_arrivals) {
  const auto made = schedule_of(arrivals);
  if (!made) return made.error();
  const auto& [schedule, slots] = *made;
  if (recording.moments.empty()) recording_begins_s = schedule.at(slots.front());
  if (arrivals.size() > max_arrivals) {
    max_arrivals = arrivals.size();
    recording.period_s = schedule.period_s;
  }
  const auto since_begin = [&, begins_s = recording_begins_s](double s) { return std::llround((s - begins_s) * 1e9); };
  std::size_t i = 0;
  for (std::int64_t slot = slots.front(); slot <= slots.back(); ++slot) {
    RecordedDelay moment{since_begin(schedule.at(slot)), 0, slots[i] != slot};
    if (!moment.lost) {
      const double late_s = std::max(0.0, arrivals[i] - schedule.at(slot));
      if (late_s > to_seconds(states_end_after_ns) + nominal_s)
        return Error{"more states come than one every 100 ms: is the capture of several ways, or doubled?"};
      moment.delay_ns = std::llround(late_s * 1e9);
      ++i;
      ++recording.came;
    } else {
      ++recording.missing;
    }
    if (recording.moments.size() > LinkRecording::max_moments)
      return Error{fmt::format("more than {} moments: cut it into shorter ones", LinkRecording::max_moments)};
    add(moment, recording.moments);
  }
  return done;
}

}  // namespace

Result<MeasuredLink> recording_of_states(std::span<const TimeNs> arrivals) {
  if (arrivals.size() < 2) return Error{fmt::format("{} state texts: at least two are needed", arrivals.size())};
  std::vector<double> all;
  all.reserve(arrivals.size());
  for (const TimeNs arrival : arrivals) all.push_back(to_seconds(arrival - arrivals.front()));
  MeasuredLink recording;
  double recording_begins_s = 0;
  std::size_t max_arrivals = 0;
  for (std::size_t begin = 0; begin < all.size();) {
    std::size_t end = begin + 1;
    while (end < all.size() && all[end] - all[end - 1] <= to_seconds(states_end_after_ns)) ++end;
    if (!recording.moments.empty()) {  // nothing came for long: one lost moment holds until the next stretch
      recording.missing += static_cast<std::size_t>((all[begin] - all[begin - 1]) / nominal_s);
      add({recording.moments.back().at_ns + state_period_ns, 0, true}, recording.moments);
    }
    if (const Status added =
            add_stretch(Arrivals(all).subspan(begin, end - begin), recording_begins_s, recording, max_arrivals);
        !added)
      return added.error();
    begin = end;
  }
  return recording;
}

Result<MeasuredLink> recording_of_answers(std::span<const RequestTime> asked) {
  MeasuredLink recording;
  constexpr TimeNs apart_ns = 1 * ns_per_ms;  // what is nearer says nothing new
  for (const RequestTime& one : asked) {
    const TimeNs at = one.at_ns - asked.front().at_ns;
    ++(one.answered_ns ? recording.came : recording.missing);
    if (!recording.moments.empty() && at - recording.moments.back().at_ns < apart_ns) continue;
    recording.moments.push_back({at, one.answered_ns ? (*one.answered_ns - one.at_ns) / 2 : 0, !one.answered_ns});
  }
  if (recording.moments.size() < 2)
    return Error{fmt::format("{} commands that are answered at once: at least two are needed", asked.size())};
  return recording;
}

}  // namespace ledgerline::hil
