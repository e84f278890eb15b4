#include <cmath>

#include "common/msg/proto_json.hpp"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/ground/core/flight_world.hpp"

/// Events in blocks as ground reads them, of drones on the ground and in the air.
namespace ledgerline::fuzz::ground_part {
namespace {

using namespace ground;

/// tello1 flies its path; tello2 waits. What is sent is within the contract's limits, whatever came.
class Flying {
 public:
  Flying() : core_(config_for(2)) {
    (void)core_.set_control(control_record("tello1", operator_name).SerializeAsString());
    (void)core_.set_control(control_record("tello2", operator_name).SerializeAsString());
    give("set", state(LinkPhase::on_ground, 0));
    for (int i = 0; i < 3; ++i) give("set", state(LinkPhase::flying, 1));
  }

  /// False: something went out that must not.
  bool give(const std::string& name, std::string payload) {
    now_ns_ += 33 * ns_per_ms;
    fabric::Block block;
    block.transactions.push_back(event(name, std::move(payload)));
    FlightInputs inputs;
    inputs.block = &block;
    const FlightOutputs out = core_.step(now_ns_, inputs);
    bool good = true;
    for (const Submission& submission : out.submissions) {
      CommandCall call;
      good = good && call.ParseFromString(submission.call.args.at(0)) && call.plans_size() <= 2;
      for (const DronePlan& plan : call.plans()) {
        good = good && flyable(plan);
        if (plan.drone() == "tello1") newest_plan_ = plan.sequence();
      }
      fabric::Outcome outcome;
      outcome.kind = fabric::Outcome::Kind::committed;
      FlightInputs ended;
      ended.outcome = &outcome;
      ended.outcome_id = submission.id;
      (void)core_.step(now_ns_, ended);
    }
    return good;
  }

  std::string state(LinkPhase phase, double height_m) {
    SetCall call;
    add_state(call, "tello1", sample(phase, height_m));
    return call.SerializeAsString();
  }
  StateSample sample(LinkPhase phase, double height_m) {
    StateSample s;
    s.phase = phase;
    s.boot_id = 9;
    s.sequence = ++sequence_;
    s.stamp_ns = s.pose_stamp_ns = now_ns_ + 33 * ns_per_ms;
    s.position_m = {0, 0, height_m};
    return s;
  }

  /// The drone's next state: still in the air, and it says of the newest plan when it came.
  StateSample next(StateSample s) {
    s.phase = LinkPhase::flying;
    s.boot_id = 9;
    s.sequence = ++sequence_;
    s.arrived_sequence = newest_plan_;
    return s;
  }

  const FlightCore& core() const { return core_; }
  bool in_path() const { return core_.status(0).phase == GroundPhase::path; }

 private:
  static bool flyable(const DronePlan& plan) {
    if (plan.setpoints_size() > 40) return false;
    for (const PlannedSetpoint& s : plan.setpoints()) {
      for (const float value : {s.vx(), s.vy(), s.vz(), s.yaw_rate()}) {
        if (!std::isfinite(value) || std::abs(value) > 20) return false;
      }
      if (s.at_ns() < 0) return false;
    }
    return true;
  }

  FlightCore core_;
  TimeNs now_ns_ = 1'000 * ns_per_s;
  std::uint64_t sequence_ = 0, newest_plan_ = 0;
};

class EventEntry final : public Entry {
 public:
  explicit EventEntry(std::string name) : name_(std::move(name)) {}

  std::vector<std::string> seeds() override {
    if (name_ == "set") {
      SetCall call;
      StateSample s = Flying().sample(LinkPhase::flying, 1);
      s.sequence = 1'000'000;  // newer than what came before
      s.stamp_ns = s.pose_stamp_ns = 1'001 * ns_per_s;
      add_state(call, "tello1", s);
      return {call.SerializeAsString(), to_json(call)};
    }
    if (name_ == "command") {
      CommandCall call;
      call.add_plans()->set_drone("tello1");
      call.mutable_plans(0)->set_sequence(3);
      call.mutable_plans(0)->set_epoch(1);
      return {call.SerializeAsString()};
    }
    Controls event;
    *event.add_controls() = control_record("tello1", operator_name, 2);
    *event.add_controls() = control_record("tello2", outsider_name, 3);
    if (name_ == "stop") {
      Stops stops;
      *stops.add_stops() = stop_of("tello1", {"Org1MSP", "CN=x"}, true);
      *stops.add_stops() = stop_of("tello2", outsider_name);
      return {stops.SerializeAsString(), to_json(stops)};
    }
    Controls stopped = event;
    *stopped.mutable_controls(0)->add_stoppers() = stop_of("tello1", {"Org1MSP", "CN=x"});
    return {event.SerializeAsString(), stopped.SerializeAsString(), to_json(stopped)};
  }

  Outcome feed(std::string_view bytes) override {
    if (!flying_ || !flying_->in_path()) flying_ = std::make_unique<Flying>();
    if (!flying_->in_path()) return refused("");
    const std::uint64_t before = flying_->core().status(0).states_received;
    if (!flying_->give(name_, std::string(bytes))) return refused("");
    const bool heard = name_ == "set" ? flying_->core().status(0).states_received > before : parses(bytes);
    // A state that was taken is the newest for good; the others leave a flight that goes on for a while.
    if (name_ == "set" ? heard : ++fed_ % 50 == 0) flying_.reset();
    return heard ? accepted() : dropped();
  }

 private:
  bool parses(std::string_view bytes) const {
    CommandCall commands;
    Controls controls;
    return name_ == "command" ? parse_message(bytes, commands).ok() : parse_message(bytes, controls).ok();
  }

  std::string name_;
  std::unique_ptr<Flying> flying_;
  int fed_ = 0;
};

/// The status alone, as CDR, of a drone in flight that has a pose; and again and again, so that one strange state
/// follows another.
class StateEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    StateSample s = Flying().sample(LinkPhase::flying, 1);
    s.boot_id = 10;
    s.sent_velocity_mps = {0.1F, 0.2F, 0.3F};
    StateSample grounded = s;
    grounded.phase = LinkPhase::on_ground;
    StateSample late = s;
    late.arrived_ns = 1'000'000 * ns_per_s;
    return {link_status_to_cdr(s, 0), link_status_to_cdr(grounded, 0), link_status_to_cdr(late, 0)};
  }
  std::vector<std::string> probes() override {
    flying_.reset();
    return {seeds()[0]};
  }
  Outcome feed(std::string_view bytes) override {
    if (++fed_ % 50 == 0 || !flying_ || !flying_->in_path()) flying_ = std::make_unique<Flying>();
    SetCall call;
    add_state(call, "tello1", flying_->sample(LinkPhase::flying, 1));
    std::string& status = *call.mutable_assets(1)->mutable_msg_data();
    status = bytes;
    // In every second flight plans come, at whatever time that says.
    if (const auto state = state_from_cdr(bytes, call.assets(0).msg_data()); state && fed_ / 50 % 2 == 0) {
      const StateSample next = flying_->next(state->sample);
      status = link_status_to_cdr(next, state->real_ns - next.stamp_ns);
    }
    const std::uint64_t before = flying_->core().status(0).states_received;
    if (!flying_->give("set", call.SerializeAsString())) return refused("");
    return flying_->core().status(0).states_received > before ? accepted() : dropped();
  }

 private:
  std::unique_ptr<Flying> flying_;
  int fed_ = 0;
};

Registered on_event(const std::string& name, double least_refused) {
  return {"ground." + name, Kind::protobuf, [=] { return std::make_unique<EventEntry>(name); }, least_refused};
}
const Registration set(on_event("set", 0.2));
const Registration command(on_event("command", 0.1));
const Registration acquire(on_event("acquire", 0.1));
const Registration state({"ground.state", Kind::bytes, [] { return std::make_unique<StateEntry>(); }});

}  // namespace
}  // namespace ledgerline::fuzz::ground_part
