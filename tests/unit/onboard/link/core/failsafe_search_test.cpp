#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <deque>
#include <unordered_set>

#include "onboard/link/core/failsafe.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

/// Every state that the failsafe can come into, searched to a fixed point with the real update(). Times are in steps
/// and every limit is a few of them; an age beyond the largest limit it is compared with stays there. What the world
/// does in a step is free: who is heard, where the drone is, whether a plan covers it, what is asked for.
namespace ledgerline::link {
namespace {

constexpr TimeNs step_ns = 100 * ms;
constexpr TimeNs now = 1000 * step_ns;
#if defined(__aarch64__)
constexpr bool emulated = true;  // the tree's tests for it run under qemu-user
#else
constexpr bool emulated = false;
#endif
constexpr int handshakes = 2;  // steps until all failed
constexpr int dark_lands = 2;  // steps until a drone in the dark is landed

/// Ages in steps. Of a moment that never was: -1.
struct State {
  int phase = 0;
  int lost = -1;  ///< disconnected, and it may fly: for so long; then all handshakes failed
  int uncovered = 0, heartbeat = 0, state = 0, pose = 0;
  int ledger_alive = 1, untrusted = 0;
  int mode = 0, cause = 0, battery_low = 0;
  int dark = -1;  ///< flying, and its flow has seen nothing for so long
  int hovering = -1, gone = -1, outward = -1, outside = -1, too_near = -1;
  int unflown = 0;  ///< since a plan was followed: counted here, not by the failsafe

  std::uint64_t key() const {
    const int bits = ledger_alive | untrusted << 1 | battery_low << 2;
    auto key = static_cast<std::uint64_t>(cause);
    const int lost_or_dark = (lost + 1) | (dark + 1) << 2;  // never both
    for (const int field : {phase, lost_or_dark, uncovered, heartbeat, state, pose, bits, mode, hovering, gone, outward,
                            outside, too_near, unflown}) {
      key = key << 4 | static_cast<std::uint64_t>(field + 1);
    }
    return key;
  }
};

enum class Place { inside, back, out };
enum class Asked { nothing, stop, cut, empty_battery };
/// What else its senses say, or that it is flown by hand.
enum class Sensed {
  well,
  tilted,
  overturned,
  differs,
  uncertain,
  dark,
  no_height,
  sources_differ,
  sources_unresolved,
  by_hand,
  by_hand_uncertain
};

struct Input {
  bool heartbeat = false, ledger_alive = false, untrusted = false, plan = false, pose = false;
  enum class Text { none, charged, low } text = Text::none;
  Place place = Place::inside;
  Asked asked = Asked::nothing;
  Sensed sensed = Sensed::well;
  bool too_near = false;
};

class Search {
 public:
  /// Where an untrusted ledger is ignored every ledger is trusted: it is not looked at (FS-14).
  Search(const std::array<int, 7>& limits, OnUntrustedLedger action, bool by_odometry)
      : limits_(limits), by_odometry_(by_odometry) {
    settings_.on_untrusted_ledger = action;
    settings_.hold_grace_ns = grace() * step_ns;
    settings_.land_after_ns = land_after() * step_ns;
    settings_.agent_silent_ns = agent_silent() * step_ns;
    settings_.state_stale_ns = stale() * step_ns;
    settings_.pose_lost_ns = settings_.velocity_lost_ns = pose_lost() * step_ns;
    settings_.clear_after_ns = clear_after() * step_ns;
    settings_.dark_land_after_ns = dark_lands * step_ns;
    settings_.fence_land_after_ns = fence_land_after() * step_ns;
  }

  /// To a fixed point, or for so many steps.
  void run(std::size_t max_steps = SIZE_MAX) {
    State start;
    start.phase = static_cast<int>(LinkPhase::taking_off);
    visit(start);
    start.phase = static_cast<int>(LinkPhase::disconnected);
    visit(start);
    while (!open_.empty() && steps_ < max_steps && !::testing::Test::HasFailure()) {
      const State from = open_.front();
      open_.pop_front();
      for (const Input& input : inputs()) {
        for (const int phase : next_phases(from.phase)) go(from, phase, input);
      }
    }
  }
  std::size_t states() const { return seen_.size(); }
  std::size_t steps() const { return steps_; }

 private:
  int grace() const { return limits_[0]; }
  int land_after() const { return limits_[1]; }
  int agent_silent() const { return limits_[2]; }
  int stale() const { return limits_[3]; }
  int pose_lost() const { return limits_[4]; }
  int clear_after() const { return limits_[5]; }
  int fence_land_after() const { return limits_[6]; }

  static std::vector<int> next_phases(int phase) {
    constexpr int lost = static_cast<int>(LinkPhase::disconnected), flying = static_cast<int>(LinkPhase::flying),
                  landing = static_cast<int>(LinkPhase::landing);
    if (phase == landing) return {phase, lost};
    if (phase == lost) return {phase, flying, landing};
    return {phase, phase + 1};
  }

  const std::vector<Input>& inputs() const {
    static const std::vector<Input> trusting = make_inputs({0, 1, 2}), untrusting = make_inputs({0, 1, 2, 3, 4});
    return settings_.on_untrusted_ledger == OnUntrustedLedger::ignore ? trusting : untrusting;
  }

  /// `heard`: no heartbeat; that the ledger is silent, that it is alive; the same, untrusted.
  static std::vector<Input> make_inputs(std::initializer_list<int> all_heard) {
    std::vector<Input> made;
    for (const int heard : all_heard)
      for (const int bits : {0, 1, 2, 3})
        for (const auto text : {Input::Text::none, Input::Text::charged, Input::Text::low})
          for (const auto place : {Place::inside, Place::back, Place::out})
            made.push_back({heard > 0, heard == 2 || heard == 4, heard > 2, (bits & 1) != 0, (bits & 2) != 0, text,
                            place, Asked::nothing});
    for (const auto asked : {Asked::stop, Asked::cut, Asked::empty_battery})
      for (const int bits : {0, 1, 2, 3})
        made.push_back(
            {(bits & 2) != 0, true, false, (bits & 1) != 0, (bits & 2) != 0, Input::Text::none, Place::inside, asked});
    if (all_heard.size() > 3) return made;  // where trust is looked at, nothing else is
    for (const auto sensed :
         {Sensed::tilted, Sensed::overturned, Sensed::differs, Sensed::uncertain, Sensed::dark, Sensed::no_height,
          Sensed::sources_differ, Sensed::sources_unresolved, Sensed::by_hand, Sensed::by_hand_uncertain})
      for (const int bits : {0, 2, 5, 7})
        made.push_back({(bits & 4) != 0, true, false, (bits & 1) != 0, (bits & 2) != 0,
                        (bits & 4) != 0 ? Input::Text::charged : Input::Text::none, Place::inside, Asked::nothing,
                        sensed});
    for (const int bits : {0, 1, 2, 3})
      made.push_back({.heartbeat = true,
                      .ledger_alive = true,
                      .plan = (bits & 1) != 0,
                      .pose = (bits & 2) != 0,
                      .text = Input::Text::charged,
                      .too_near = true});
    return made;
  }

  // One step later: older, but for what was heard.
  State aged(const State& from, int phase, const Input& input) const {
    State s = from;
    s.phase = phase;
    s.lost = phase == static_cast<int>(LinkPhase::disconnected) ? std::min(s.lost + 1, handshakes) : -1;
    const bool dark = input.sensed == Sensed::dark && phase == static_cast<int>(LinkPhase::flying);
    s.dark = dark ? std::min(s.dark + 1, dark_lands) : -1;
    const bool begins = phase != from.phase && phase == static_cast<int>(LinkPhase::flying);
    s.uncovered = input.plan || begins ? 0 : std::min(s.uncovered + 1, grace());
    s.unflown = begins ? 0 : std::min(s.unflown + 1, land_after() + grace() + 1);
    s.state =
        input.text != Input::Text::none || input.asked == Asked::empty_battery ? 0 : std::min(s.state + 1, stale() + 1);
    // Two old moments keep their order: which was heard last, agent or the pose, is asked for.
    const int silent = agent_silent() + 1;
    if (input.pose) {
      s.pose = 0;
    } else if (input.heartbeat || s.heartbeat < silent || s.pose < silent) {
      s.pose = std::min(s.pose + 1, silent + pose_lost());
    }
    s.heartbeat = input.heartbeat ? 0 : std::min(s.heartbeat + 1, silent);
    if (input.heartbeat) s.ledger_alive = input.ledger_alive;
    if (input.heartbeat) s.untrusted = input.untrusted;
    return s;
  }

  FailsafeInputs inputs(const State& s, const Input& input) const {
    FailsafeInputs f;
    f.phase = static_cast<LinkPhase>(s.phase);
    f.may_be_airborne = s.lost >= 0;
    f.contact_lost = s.lost >= handshakes;
    f.plan_valid = input.plan;
    f.covered_until_ns = f.flying_since_ns = now - s.uncovered * step_ns;
    f.heartbeat_ns = now - s.heartbeat * step_ns;
    f.ledger_alive = s.ledger_alive != 0;
    f.ledger_untrusted = s.untrusted != 0;
    f.state_ns = now - s.state * step_ns;
    f.pose_ns = now - s.pose * step_ns;
    f.position_m = {input.place == Place::inside ? 0 : fence_.max_m[0] + 0.5, 0, 1};
    f.velocity_mps = {input.place == Place::out ? 0.5 : -0.5, 0, 0};
    f.height_m = input.place == Place::out ? static_cast<float>(fence_.max_m[2]) + 0.5F : 1;
    f.battery = settings_.battery_low + settings_.battery_margin / 2;  // neither low again nor charged
    if (input.text == Input::Text::charged) f.battery = 1;
    if (input.text == Input::Text::low) f.battery = settings_.battery_low;
    if (input.asked == Asked::empty_battery) f.battery = settings_.battery_critical;
    f.stop = input.asked == Asked::stop;
    f.cut = input.asked == Asked::cut;
    f.by_odometry = by_odometry_;
    f.tilted = input.sensed == Sensed::tilted || input.sensed == Sensed::overturned;
    f.overturned = input.sensed == Sensed::overturned;
    f.motion_differs = input.sensed == Sensed::differs;
    f.dark_since_ns = since(s.dark);
    f.height_lost = input.sensed == Sensed::no_height;
    f.sources_unresolved = input.sensed == Sensed::sources_unresolved;
    f.sources_differ = f.sources_unresolved || input.sensed == Sensed::sources_differ;
    f.needs_position = input.sensed != Sensed::by_hand && input.sensed != Sensed::by_hand_uncertain;
    if (input.sensed == Sensed::uncertain || input.sensed == Sensed::by_hand_uncertain) f.sigma_m = {50, 50, 0.1};
    f.too_near = input.too_near;
    return f;
  }

  static TimeNs since(int age) { return age < 0 ? 0 : now - age * step_ns; }
  static int age(TimeNs since, int most) {
    return since == 0 ? -1 : static_cast<int>(std::min<TimeNs>((now - since) / step_ns, most));
  }
  static int older(int age) { return age < 0 ? -1 : age + 1; }

  void go(const State& from, int phase, const Input& input) {
    ++steps_;
    State s = aged(from, phase, input);
    const FailsafeState last{.mode = static_cast<FailsafeMode>(from.mode),
                             .cause = static_cast<FailsafeCause>(from.cause),
                             .hovering_since_ns = since(older(from.hovering)),
                             .cause_gone_since_ns = since(older(from.gone)),
                             .outward_since_ns = since(older(from.outward)),
                             .outside_ns = since(older(from.outside)),
                             .too_near_ns = since(older(from.too_near)),
                             .battery_low = from.battery_low != 0};
    const FailsafeInputs f = inputs(s, input);
    const FailsafeState next = update(settings_, fence_, last, now, f);
    s.mode = static_cast<int>(next.mode);
    s.cause = static_cast<int>(next.cause);
    s.battery_low = next.battery_low;
    s.hovering = age(next.hovering_since_ns, land_after());
    s.gone = age(next.cause_gone_since_ns, clear_after());
    s.outward = age(next.outward_since_ns, fence_land_after());
    s.outside = age(next.outside_ns, clear_after() + 1);
    s.too_near = now - next.too_near_ns > settings_.clear_after_ns ? -1 : age(next.too_near_ns, clear_after());
    if (follows_plan(next.mode, f.plan_valid)) s.unflown = 0;
    check(s, last, next, f);
    if (next.mode >= FailsafeMode::land) s = landing(s);
    visit(s);
  }

  // The failsafe looks at nothing but a cut any more (check() sees to that): what else is remembered is let go.
  static State landing(const State& s) {
    State kept;
    kept.phase = s.phase;
    kept.lost = s.lost;
    kept.mode = s.mode;
    kept.cause = s.cause;
    return kept;
  }

  // Whether what decided before may end now, said without the table: in which state its clear condition holds.
  bool may_end(const State& s, const FailsafeState& last, const FailsafeInputs& f) const {
    switch (last.mode) {
      case FailsafeMode::none:
        if (last.cause == FailsafeCause::fence)
          return f.position_m[0] <= fence_.max_m[0] && now - last.outside_ns > settings_.clear_after_ns;
        if (last.cause == FailsafeCause::too_near)
          return !f.too_near && now - last.too_near_ns > settings_.clear_after_ns;
        return last.cause != FailsafeCause::battery_low || f.battery > settings_.battery_low + settings_.battery_margin;
      case FailsafeMode::hold:
        return f.plan_valid;
      case FailsafeMode::brake: {
        const bool seen = last.cause != FailsafeCause::state_stale || 2 * s.state <= stale();
        const bool by_pose = last.cause == FailsafeCause::pose_lost || last.cause == FailsafeCause::velocity_lost ||
                             last.cause == FailsafeCause::height_lost;
        if (f.dark_since_ns != 0 && f.needs_position) return false;
        const bool placed =
            !by_pose || 2 * s.pose <= pose_lost() || (!by_odometry_ && s.pose <= s.heartbeat) || !f.needs_position;
        const bool sure = last.cause != FailsafeCause::position_uncertain || f.sigma_m[0] <= 0 || !f.needs_position;
        const bool agree = last.cause != FailsafeCause::sources_differ || !f.sources_differ || !f.needs_position;
        const bool trusted = last.cause != FailsafeCause::ledger_untrusted || !f.ledger_untrusted;
        return seen && placed && sure && agree && trusted && last.cause_gone_since_ns != 0 &&
               now - last.cause_gone_since_ns > settings_.clear_after_ns;
      }
      case FailsafeMode::land:
      case FailsafeMode::cut:
        return !is_in_flight(f.phase);
    }
    return false;
  }

  void check(const State& s, const FailsafeState& last, const FailsafeState& next, const FailsafeInputs& f) {
    const auto fail = [&](const char* what) {
      ADD_FAILURE() << what << ": mode " << s.mode << " cause " << s.cause << " phase " << s.phase << " plan "
                    << f.plan_valid << "; ages: uncovered " << s.uncovered << " heartbeat " << s.heartbeat << " state "
                    << s.state << " pose " << s.pose << " hovering " << s.hovering << " unflown " << s.unflown
                    << "; before: mode " << static_cast<int>(last.mode) << " cause " << static_cast<int>(last.cause);
    };
    const bool ended = next.mode == FailsafeMode::none && next.cause == FailsafeCause::none;
    if (ended && f.phase == LinkPhase::flying && !may_end(s, last, f)) fail("a row ended too early");
    const bool down = next.mode >= FailsafeMode::land;
    if (next.mode < last.mode && last.mode >= FailsafeMode::land) fail("a landing was taken back in the air");
    if (f.cut && next.mode != FailsafeMode::cut) fail("a cut was not obeyed");
    if (next.mode == FailsafeMode::cut && !f.cut && !f.overturned && last.mode != FailsafeMode::cut)
      fail("a cut nobody asked for");
    if ((f.stop || f.battery <= settings_.battery_critical) && !down) fail("a stop or an empty battery does not land");
    if (f.overturned && is_in_flight(f.phase) && next.mode != FailsafeMode::cut) fail("overturned, and its motors run");
    if (f.tilted && is_in_flight(f.phase) && !down) fail("it is tilted, and is not landed");
    if (f.motion_differs && f.phase == LinkPhase::flying && !down) fail("it moves otherwise, and is not landed");
    if (s.dark >= dark_lands && !down) fail("it sees nothing, and is not landed");
    if (f.sources_unresolved && f.phase == LinkPhase::flying && !down) fail("nothing to fly by, and it is not landed");
    if (f.contact_lost && !down) fail("it may be airborne without state, and is not landed");
    if (f.ledger_untrusted && settings_.on_untrusted_ledger == OnUntrustedLedger::land && !down)
      fail("the ledger is not trusted, and it is not landed");
    if (f.phase != LinkPhase::flying) return;

    const bool follows = follows_plan(next.mode, f.plan_valid);
    if (!follows && next.mode == FailsafeMode::none && s.uncovered >= grace()) fail("neither a plan nor an action");
    if (!down && s.unflown > land_after() + grace()) fail("no plan for longer than land_after, and no landing");
    if (follows && s.state > stale()) fail("flies on though the drone is silent");
    const bool lost = s.pose > pose_lost() && (by_odometry_ || s.pose - s.heartbeat > pose_lost() / 2);
    if (follows && f.needs_position && lost) fail("flies a path though the pose is lost");
    if (follows && f.dark_since_ns != 0) fail("flies a path in the dark");
    if (follows && f.needs_position && f.sigma_m[0] > 0) fail("flies a path though its position is uncertain");
    if (follows && f.ledger_untrusted) fail("flies on though the ledger is not trusted");
    if (next.mode == FailsafeMode::hold && f.plan_valid) fail("holds though there is a plan");
    if (f.too_near && follows && next.cause != FailsafeCause::too_near)
      fail("another is in its way, and it is not reported");
    if (next.mode != FailsafeMode::none && next.cause == FailsafeCause::none) fail("a mode without a cause");
  }

  void visit(const State& s) {
    if (seen_.insert(s.key()).second) open_.push_back(s);
  }

  std::array<int, 7> limits_;
  bool by_odometry_;
  FailsafeSettings settings_;
  FenceSettings fence_;
  std::unordered_set<std::uint64_t> seen_;
  std::deque<State> open_;
  std::size_t steps_ = 0;
};

TEST(FailsafeSearch, NoReachableStateHasNeitherAFreshPlanNorAnAction) {
  // Limits in steps, in the order of the defaults' sizes: hold_grace, land_after, agent_silent, state_stale, pose_lost,
  // clear_after, fence_land_after.
  const bool whole = seeds(0, 1) == 1;
  for (const auto& [action, by_odometry] :
       {std::pair(OnUntrustedLedger::ignore, false), std::pair(OnUntrustedLedger::ignore, true),
        std::pair(OnUntrustedLedger::hold, false), std::pair(OnUntrustedLedger::land, false)}) {
    Search search(whole ? std::array{1, 7, 3, 4, 2, 3, 4} : std::array{1, 4, 2, 3, 2, 2, 2}, action, by_odometry);
    // What a sanitizer looks for shows in the first million steps, or not at all. Under an emulator, too, all steps
    // take ten times as long; its first ones show whether this compiler's code finds the states that another's does.
    if (slow || (emulated && !whole)) {
      search.run(slow ? 1'000'000 : 5'000'000);
      EXPECT_GT(search.states(), slow ? 10'000U : 30'000U) << "the search did not get anywhere";
      continue;
    }
    search.run();
    std::printf("untrusted ledger: %s, poses of %s: %zu states of the failsafe visited, %zu steps taken\n",
                name(action), by_odometry ? "onboard odometry" : "motion capture", search.states(), search.steps());
    EXPECT_GT(search.states(), whole ? 500'000U : 100'000U) << "the search did not get anywhere";
  }
}

}  // namespace
}  // namespace ledgerline::link
