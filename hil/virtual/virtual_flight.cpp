#include "hil/virtual/virtual_flight.hpp"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <string_view>
#include <tuple>

#include "common/belief/control_records.hpp"
#include "common/msg/ros.hpp"
#include "ground/core/flight.hpp"
#include "hil/virtual/digester.hpp"
#include "hil/virtual/world_setup.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/core/agent_core.hpp"
#include "onboard/link/core/link_core.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs tick_ns = 1 * ns_per_ms;
constexpr TimeNs ground_period_ns = 50 * ns_per_ms;
constexpr TimeNs beat_period_ns = 50 * ns_per_ms;
constexpr TimeNs truth_period_ns = 33 * ns_per_ms;
constexpr std::int64_t real_epoch_s = 1'767'225'600;
constexpr sim::Endpoint link_endpoint{0x7F000001, 40000};

class Flight {
 public:
  explicit Flight(const VirtualFlightConfig& config)
      : config_(config),
        ledger_(node_config(config), config.delays, config.seed),
        sim_(sim_parameters(config), 0),
        link_(link_settings(config), config.seed),
        agent_(agent_config(config), ledger_.registry()),
        ground_(ground_config(config, ledger_)) {
    agent_.set_real_offset(real_epoch_s * ns_per_s);
  }

  Result<VirtualFlightResult> run() {
    if (auto s = set_up(); !s) return s.error();
    while (!ground_.done() && now_ < config_.max_ns) {
      now_ += tick_ns;
      step_sim();
      if (local()) {
        step_local();
      } else {
        ledger_.step(now_);
        step_agent();
        step_ground();
      }
      step_link();
    }
    link_.finish();
    return result();
  }

 private:
  static node::CoreConfig node_config(const VirtualFlightConfig& config) {
    node::CoreConfig node;
    node.batch_count = config.batch_count;
    node.batch_timeout_ns = config.batch_timeout_ns;
    return node;
  }
  static sim::Parameters sim_parameters(const VirtualFlightConfig& config) {
    sim::Parameters parameters;
    parameters.drones = config.drones;
    parameters.seed = config.seed;
    parameters.wind.gust_mps = config.gust_mps;
    // A heavier drone hovers as well as any, its flight controller sees to that; but the same wind moves it less, and
    // its motors have less to spare.
    const double factor = 1 + config.model_error;
    parameters.body.mass_kg *= factor;
    parameters.body.drag_xy_per_s /= factor;
    parameters.body.drag_z_per_s /= factor;
    parameters.body.max_thrust_by_weight /= factor;
    parameters.control.velocity_lag_s *= factor;
    parameters.sdk.rc_full_mps = config.full_scale_mps * factor;
    parameters.control.max_speed_mps = std::max(parameters.control.max_speed_mps, 1.5 * config.full_scale_mps);
    return parameters;
  }
  static link::LinkSettings link_settings(const VirtualFlightConfig& config) {
    link::LinkSettings settings;
    settings.rate_hz = config.rate_hz;
    settings.rc.full_scale_mps = static_cast<float>(config.full_scale_mps);
    settings.playout.max_speed_mps =
        std::max(settings.playout.max_speed_mps, 1.5F * static_cast<float>(config.full_scale_mps));
    settings.playout.max_age_ns = std::max(settings.playout.max_age_ns, max_age_ns(config));
    settings.playout.max_margin_ns = 0;  // ground counts on plans taking over as they come
    for (int k = 1; k <= config.drones; ++k) settings.drones.push_back({drone_name(k), static_cast<DroneNumber>(k)});
    return settings;
  }
  static agent::AgentConfig agent_config(const VirtualFlightConfig& config) {
    agent::AgentConfig agent;
    agent.seed = config.seed;
    if (const TimeNs max_age = max_age_ns(config); max_age > 0) {
      agent.check.max_age_ns = max_age;
      agent.ledger_silent_after_ns += max_age;  // a far ledger is not yet a silent one
    }
    for (int k = 1; k <= config.drones; ++k) agent.drones.push_back({static_cast<DroneNumber>(k), drone_name(k)});
    return agent;
  }
  static ground::FlightConfig ground_config(const VirtualFlightConfig& config, VirtualLedger& ledger) {
    ground::FlightConfig ground;
    for (int k = 1; k <= config.drones; ++k) ground.drones.push_back({drone_name(k), static_cast<DroneNumber>(k)});
    ground.shape = config.shape;
    ground.side_m = config.side_m;
    ground.waypoints = config.waypoints;
    ground.ledger = config.mode == VirtualFlightConfig::Mode::ledger;
    ground.controller.predict = config.predict;
    ground.controller.ramp = config.ramp;
    const link::LinkSettings link = link_settings(config);
    ground.controller.told_mps = static_cast<double>(link.rc.full_scale_mps);
    ground.controller.told_mps2 = static_cast<double>(link.playout.max_acceleration_mps2);
    ground.controller.pose_lost_ns = link.failsafe.pose_lost_ns;
    ground.laps = config.laps;
    ground.controller.speed_mps = config.speed_mps;
    ground.self = operator_name;
    ground.believed = ledger.shared_registry();
    return ground;
  }

  // Of a command; 0: the defaults.
  static TimeNs max_age_ns(const VirtualFlightConfig& config) {
    if (config.max_age_ns > 0) return config.max_age_ns;
    return config.delays.added.kind == AddedDelay::Kind::none ? 0 : 5 * ns_per_s;
  }
  bool local() const { return config_.mode == VirtualFlightConfig::Mode::local; }

  Status set_up() {
    if (auto s = prepare(ledger_, config_.drones); !s) return s;
    host_ = ledger_.add_client(drone_host, WayDelay::Way::back, config_.delays.added.agent_share);
    operator_ = ledger_.add_client(operator_name, WayDelay::Way::there, 1 - config_.delays.added.agent_share);
    for (const auto& drone : ground_.drones()) {
      const auto control = belief::read_control(
          drone.name, [this](const fabric::Call& call) { return ledger_.evaluate(0, operator_, call); });
      if (!control) return control.error();
      agent_.set_control(0, *control);
      if (auto s = ground_.set_control(control->SerializeAsString()); !s) return s;
    }
    tracking_.resize(ground_.drones().size());
    heights_.resize(ground_.drones().size());
    fusions_.resize(ground_.drones().size(), agent::Fusion({}));
    return done;
  }

  void step_sim() {
    const auto& out = sim_.step(now_);
    for (const auto& datagram : out.datagrams) {
      digest_.put(datagram.bytes);
      to_link_.push_back(datagram);
    }
    poses_.clear();
    for (const auto& pose : out.poses) {
      const agent::MocapPose measured{pose.stamp_ns, pose.position_m, yaw_from_quaternion(pose.orientation)};
      if (local()) {
        auto fused = fusions_[pose.drone - 1U].add(measured);
        if (!fused) continue;
        fused->drone = pose.drone;
        poses_.push_back(*fused);
      } else {
        agent_.on_mocap(now_, pose.drone, measured, agent_out_);
      }
    }
    if (now_ >= next_truth_ns_) {
      next_truth_ns_ = now_ + truth_period_ns;
      track();
    }
  }

  void track() {
    for (std::size_t i = 0; i < tracking_.size(); ++i) {
      const auto status = ground_.status(i);
      if (status.phase != ground::DronePhase::path) continue;
      const auto truth = sim_.truth(ground_.drones()[i].number);
      const double error = ground_.controller(i)->path().distance_m({truth.position_m[0], truth.position_m[1]});
      if (tracking_[i].empty()) heights_[i] = {truth.position_m[2], truth.position_m[2]};
      heights_[i].first = std::min(heights_[i].first, truth.position_m[2]);
      heights_[i].second = std::max(heights_[i].second, truth.position_m[2]);
      tracking_[i].push_back({now_, error, std::hypot(truth.velocity_mps[0], truth.velocity_mps[1])});
    }
  }

  // States and plans go from hand to hand.
  void step_local() {
    ground::FlightInputs inputs;
    inputs.states = states_;
    beats_.clear();
    if (now_ >= next_beat_ns_) {
      next_beat_ns_ = now_ + beat_period_ns;
      AgentBeat beat;
      beat.stamp_ns = now_;
      beat.ledger_alive = true;
      beats_.push_back(beat);
    }
    plans_.clear();
    if (!states_.empty() || now_ >= next_ground_ns_) give_ground(inputs);
  }

  void step_agent() {
    for (const auto& state : states_) agent_.on_state(now_, state, agent_out_);
    for (const auto& transition : transitions_) agent_.on_transition(transition);
    for (const auto& ended : ledger_.take_outcomes(now_, host_))
      agent_.on_outcome(now_, ended.id, ended.outcome, agent_out_);
    for (const auto& block : ledger_.take_blocks(now_, host_)) agent_.on_block(now_, block, agent_out_);
    agent_.step(now_, agent_out_);
    for (const auto& submit : agent_out_.submits) ledger_.submit(now_, host_, submit.frame, submit.call);
    for (const auto& trace : agent_out_.traces) digest_.put(trace);
    plans_ = agent_out_.plans;
    poses_ = agent_out_.poses;
    beats_.clear();
    if (agent_out_.beat) beats_.push_back(*agent_out_.beat);
    agent_out_.clear();
  }

  void step_ground() {
    for (const auto& ended : ledger_.take_outcomes(now_, operator_)) {
      ground::FlightInputs inputs;
      inputs.outcome = &ended.outcome;
      inputs.outcome_id = ended.id;
      give_ground(inputs);
    }
    for (const auto& block : ledger_.take_blocks(now_, operator_)) {
      ground::FlightInputs inputs;
      inputs.block = &block;
      give_ground(inputs);
    }
    if (now_ >= next_ground_ns_) give_ground({});
  }

  void give_ground(ground::FlightInputs inputs) {
    next_ground_ns_ = now_ + ground_period_ns;
    inputs.realtime_s = real_epoch_s + now_ / ns_per_s;
    const auto out = ground_.step(now_, inputs);
    plans_.insert(plans_.end(), out.plans.begin(), out.plans.end());
    for (const Plan& plan : out.plans) two_way_[plan.drone].add(now_ - plan.state_stamp_ns);
    for (const auto& submission : out.submissions) ledger_.submit(now_, operator_, submission.id, submission.call);
    for (const auto& trace : out.traces) digest_.put(trace);
  }

  void step_link() {
    received_.clear();
    for (const auto& datagram : to_link_) {
      const auto port = datagram.to.port == sim::state_port ? link::Port::state : link::Port::answer;
      received_.push_back({datagram.drone, port, datagram.bytes});
    }
    link::LinkInputs inputs;
    inputs.received = received_;
    inputs.plans = plans_;
    inputs.poses = poses_;
    inputs.beats = beats_;
    const auto& out = link_.step(now_, inputs);
    to_link_.clear();
    for (const auto& send : out.to_send) {
      digest_.put(send.command.view());
      sim_.datagram(send.drone, link_endpoint, send.command.view());
    }
    states_.assign(out.states.begin(), out.states.end());
    transitions_.assign(out.transitions.begin(), out.transitions.end());
    for (const auto& trace : out.trace) digest_.put(trace);
  }

  VirtualFlightResult result() {
    VirtualFlightResult result;
    result.ok = ground_.ok();
    result.why = ground_.done() ? ground_.why() : fmt::format("not over after {:.0f} s", to_seconds(now_));
    result.flown_ns = now_;
    result.blocks = ledger_.height();
    result.transactions = ledger_.transactions();
    for (const auto& block : ledger_.blocks()) digest_.put(block);
    result.digest = digest_.result();
    const auto reports = link_.reports();
    for (std::size_t i = 0; i < reports.size(); ++i) {
      const ground::FlightStatus status = ground_.status(i);
      VirtualFlightResult::Drone drone;
      drone.name = reports[i].name;
      drone.two_way_ms = local() ? two_way_[reports[i].number].quantiles_ms()
                                 : agent_.report(reports[i].number).two_way.quantiles_ms();
      drone.age_ms = reports[i].age_ms;
      std::tie(drone.cross_track_rms_m, drone.cross_track_max_m, std::ignore) = flown(i, 0, now_);
      std::tie(drone.lowest_m, drone.highest_m) = heights_[i];
      drone.lap_s = status.lap_s;
      drone.laps = laps(i, status);
      drone.limit_mps = status.limit_mps;
      drone.slowed_to_mps = status.slowed_to_mps;
      drone.response = status.response;
      drone.commands_sent = status.commands_sent;
      drone.commands_applied = reports[i].plans.applied;
      result.drones.push_back(std::move(drone));
    }
    return result;
  }

  // Rms and greatest cross-track error and greatest speed between two moments.
  std::tuple<double, double, double> flown(std::size_t drone, TimeNs from_ns, TimeNs to_ns) const {
    double squares = 0, most = 0, fastest = 0;
    std::uint64_t count = 0;
    for (const auto& [t_ns, error, speed] : tracking_[drone]) {
      if (t_ns < from_ns || t_ns >= to_ns) continue;
      squares += error * error;
      most = std::max(most, error);
      fastest = std::max(fastest, speed);
      ++count;
    }
    return {count ? std::sqrt(squares / static_cast<double>(count)) : 0, most, fastest};
  }

  std::vector<VirtualFlightResult::Drone::Lap> laps(std::size_t i, const ground::FlightStatus& status) const {
    std::vector<VirtualFlightResult::Drone::Lap> laps;
    const ground::PathController* controller = ground_.controller(i);
    TimeNs from_ns = status.path_ns[0];
    for (const double lap_s : status.lap_s) {
      const TimeNs to_ns = from_ns + from_seconds(lap_s);
      VirtualFlightResult::Drone::Lap lap;
      lap.asked_mps = controller->asked_mps((static_cast<double>(laps.size()) + 0.5) * controller->lap_m());
      lap.flown_mps = controller->lap_m() / lap_s;
      lap.seconds = lap_s;
      std::tie(lap.rms_m, lap.max_m, lap.peak_mps) = flown(i, from_ns, to_ns);
      laps.push_back(lap);
      from_ns = to_ns;
    }
    return laps;
  }

  VirtualFlightConfig config_;
  VirtualLedger ledger_;
  sim::Simulator sim_;
  link::LinkCore link_;
  agent::AgentCore agent_;
  ground::FlightCore ground_;
  VirtualLedger::Client host_ = 0, operator_ = 0;
  TimeNs now_ = 0, next_truth_ns_ = 0, next_ground_ns_ = 0;

  // On their way between two cores.
  std::vector<sim::Outgoing> to_link_;
  std::vector<link::Received> received_;
  std::vector<StateSample> states_;
  std::vector<Transition> transitions_;
  std::vector<Plan> plans_;
  std::vector<Pose> poses_;
  std::vector<AgentBeat> beats_;
  agent::AgentOutputs agent_out_;

  std::vector<std::vector<std::tuple<TimeNs, double, double>>> tracking_;  ///< of each: cross-track error and speed
  std::vector<std::pair<double, double>> heights_;                         ///< lowest and highest of each, on its path
  std::vector<agent::Fusion> fusions_;                                     ///< local: agent is not there
  std::map<DroneNumber, Histogram> two_way_;                               ///< local
  TimeNs next_beat_ns_ = 0;
  Digester digest_;
};

}  // namespace

Result<VirtualFlightResult> fly_virtually(const VirtualFlightConfig& config) {
  if (config.drones < 1 || config.drones > max_drones) {
    return Error{fmt::format("{} drones asked for; 1 to {} can fly", config.drones, max_drones)};
  }
  if (config.model_error < -0.5 || config.model_error > 1)
    return Error{fmt::format("a model error of {}: -0.5 to 1 can be flown", config.model_error)};
  if (config.mode == VirtualFlightConfig::Mode::local && config.delays.added.kind != AddedDelay::Kind::none)
    return Error{"a local flight has no ledger that could be delayed"};
  return Flight(config).run();
}

}  // namespace ledgerline::hil
