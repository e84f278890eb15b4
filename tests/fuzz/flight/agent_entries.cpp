#include <algorithm>
#include <cmath>
#include <cstring>

#include "common/msg/proto_json.hpp"
#include "onboard/agent/core/agent_core.hpp"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

/// Events in blocks as agent reads them: rightly signed and endorsed, by those who may, with anything in them.
namespace ledgerline::fuzz::agent_part {
namespace {

using namespace agent;
using agent::testing::control;
using agent::testing::LedgerOfTests;

constexpr TimeNs stamp = 100 * ns_per_s;

std::string plans(const char* json) {
  CommandCall call;
  (void)parse_message(json, call);
  return call.SerializeAsString();
}

const char* const fly =
    R"({"plans":[{"drone":"tello1","action":"FLY","bootId":"9","stateStampNs":"100000000000","sequence":"3","epoch":"1","setpoints":[{"atNs":"100050000000","vx":0.5,"vy":-0.25,"vz":0.125,"yawRate":1},{"atNs":"100100000000","vx":0.5}]}]})";
const char* const land =
    R"({"plans":[{"drone":"tello1","action":"LAND","bootId":"9","stateStampNs":"100000000000","sequence":"4","epoch":"1"},{"drone":"tello7","action":"FLY"}]})";

/// A new agent for each input, with one state on its way, so that a command can answer it.
class EventEntry final : public Entry {
 public:
  EventEntry(std::string name, std::vector<std::string> seeds) : name_(std::move(name)), seeds_(std::move(seeds)) {}
  std::vector<std::string> seeds() override { return seeds_; }

  Outcome feed(std::string_view bytes) override {
    AgentCoreSettings settings;
    settings.drones = {{1, "tello1"}, {2, "tello2"}};
    AgentCore core(settings, *registry_);
    for (const char* drone : {"tello1", "tello2"}) core.set_control(stamp, control(drone, 1));
    AgentOutputs out;
    StateSample state;
    state.drone = 1;
    state.phase = LinkPhase::flying;
    state.boot_id = 9;
    state.sequence = 1;
    state.stamp_ns = stamp;
    core.on_state(stamp, state, out);
    core.step(stamp + ns_per_ms, out);

    LedgerOfTests ledger;
    LedgerOfTests::Tx event;
    event.event_name = name_;
    event.event_payload = bytes;
    core.on_block(stamp + 20 * ns_per_ms, ledger.block({event}), out);
    core.step(stamp + 21 * ns_per_ms, out);
    if (!core.last_chain_error().empty()) return refused("");
    for (const Plan& plan : out.plans) {
      if (!flyable(plan)) return refused("");
    }
    const bool reported = std::any_of(out.traces.begin(), out.traces.end(),
                                      [](const TraceRecord& r) { return r.kind == TraceKind::refused; });
    const bool taken = !out.plans.empty();
    if (taken) return accepted();
    const bool says_plans = name_ == "command" || name_ == "stop";  // what it changes, it also tells link
    if (!says_plans && !reported) return accepted();  // a record was changed, or it was about other drones
    // It did nothing: so a good command is taken after it.
    LedgerOfTests::Tx good;
    good.event_payload = plans(fly);
    core.on_block(stamp + 22 * ns_per_ms, ledger.block({good}), out);
    core.step(stamp + 23 * ns_per_ms, out);
    return out.plans.size() == 1 ? dropped() : refused("");
  }

 private:
  static bool flyable(const Plan& plan) {
    if (plan.drone < 1 || plan.drone > 2 || plan.count > max_setpoints) return false;
    for (std::uint32_t i = 0; i < plan.count; ++i) {
      const Setpoint& s = plan.setpoints[i];
      if (!(std::hypot(s.velocity_mps[0], s.velocity_mps[1], s.velocity_mps[2]) <= 8.001F)) return false;
      if (!(std::abs(s.yaw_rate_radps) <= 3.501F) || s.at_ns < stamp || s.at_ns > stamp + 3 * ns_per_s) return false;
    }
    return true;
  }

  std::string name_;
  std::vector<std::string> seeds_;
  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
};

/// Records as they are, and what an acquire by the holder makes of tello1's: apply_stops changes nothing.
std::vector<std::string> controls(bool acquired) {
  Controls event, both;
  Control record = control("tello1", 1);
  *both.add_controls() = control("tello2", 1);
  if (acquired) record.set_priority(2);
  *event.add_controls() = record;
  *both.add_controls() = record;
  return {event.SerializeAsString(), both.SerializeAsString(), to_json(both)};
}

std::vector<std::string> stops() {
  Stops one, two;
  *one.add_stops() = agent::testing::stop_of("tello1", true);
  *two.add_stops() = agent::testing::stop_of("tello1");
  *two.add_stops() = agent::testing::stop_of("tello2");
  return {one.SerializeAsString(), two.SerializeAsString(), to_json(two)};
}

/// Positions of motion capture, any bytes as numbers: what comes out is finite.
class MocapEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    std::vector<std::string> all;
    for (double x : {0.0, 1.0}) {
      MocapPose pose{stamp, {x, 2, 1}, 0.5};
      all.emplace_back(reinterpret_cast<const char*>(&pose), sizeof pose);
    }
    return all;
  }
  Outcome feed(std::string_view bytes) override {
    if (bytes.size() < sizeof(MocapPose)) return dropped();
    MocapPose pose;
    std::memcpy(static_cast<void*>(&pose), bytes.data(), sizeof pose);
    Fusion fusion{FusionSettings{}};
    const MocapPose first{stamp - 10 * ns_per_ms, {0, 2, 1}, 0.5};
    (void)fusion.add(first);
    const auto fused = fusion.add(pose);
    if (!fused) return dropped();
    for (const double value : {fused->position_m[0], fused->velocity_mps[0], fused->velocity_mps[2], fused->yaw_rad}) {
      if (!std::isfinite(value)) return refused("");
    }
    return accepted();
  }
  std::vector<std::string> probes() override { return {seeds()[0]}; }
};

const Registration command(
    {"agent.command", Kind::protobuf, [] {
       return std::make_unique<EventEntry>("command", std::vector<std::string>{plans(fly), plans(land)});
     }});
const Registration command_json({"agent.command_json", Kind::json, [] {
                                   return std::make_unique<EventEntry>("command", std::vector<std::string>{fly, land});
                                 }});
const Registration stop({"agent.stop", Kind::protobuf, [] { return std::make_unique<EventEntry>("stop", stops()); }});
const Registration apply_stops({"agent.apply_stops", Kind::protobuf,
                                [] { return std::make_unique<EventEntry>("apply_stops", controls(false)); }, 0.1});
const Registration acquire({"agent.acquire", Kind::protobuf,
                            [] { return std::make_unique<EventEntry>("acquire", controls(true)); }, 0.1});
const Registration mocap({"agent.mocap", Kind::bytes, [] { return std::make_unique<MocapEntry>(); }});

}  // namespace
}  // namespace ledgerline::fuzz::agent_part
