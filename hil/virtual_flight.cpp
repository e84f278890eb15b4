#include "hil/virtual_flight.hpp"

#include <fmt/format.h>

#include <cmath>
#include <string_view>

#include "common/msg/ros.hpp"
#include "ground/core/flight.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/agent_core.hpp"
#include "onboard/link/link_core.hpp"
#include "sim/simulator.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs tick_ns = 1 * ns_per_ms;
constexpr TimeNs ground_period_ns = 50 * ns_per_ms;
constexpr TimeNs truth_period_ns = 33 * ns_per_ms;
constexpr std::int64_t real_epoch_s = 1'767'225'600;
constexpr sim::Endpoint link_endpoint{0x7F000001, 40000};

const crypto::IdentityName drone_host{"Org1MSP", "CN=User1@org1.ledgerline"};
const crypto::IdentityName operator_name{"Org2MSP", "CN=User1@org2.ledgerline"};

std::string drone_name(int number) { return fmt::format("tello{}", number); }

// SHA-256 of everything that is put in, folded whenever a megabyte has come together.
class Digester {
 public:
  void put(std::string_view bytes) {
    buffer_.append(bytes);
    if (buffer_.size() > 1'000'000) fold();
  }
  void put(const TraceRecord& record) { put({reinterpret_cast<const char*>(&record), sizeof record}); }
  crypto::Digest result() {
    fold();
    crypto::Digest digest{};
    std::copy(buffer_.begin(), buffer_.end(), digest.begin());
    return digest;
  }

 private:
  void fold() {
    const crypto::Digest digest = crypto::sha256(buffer_);
    buffer_.assign(digest.begin(), digest.end());
  }
  std::string buffer_;
};

// enroll and acquire, as the launcher does before take-off.
Status prepare(VirtualLedger& ledger, const std::vector<std::string>& drones) {
  const auto admin1 = ledger.add_client({"Org1MSP", "CN=Admin@org1.ledgerline"});
  const auto admin2 = ledger.add_client({"Org2MSP", "CN=Admin@org2.ledgerline"});
  const auto holder = ledger.add_client(operator_name);

  EnrollCall host;
  host.mutable_identity()->set_msp_id(drone_host.msp_id);
  host.mutable_identity()->set_subject(drone_host.subject);
  EnrollCall role;
  role.mutable_identity()->set_msp_id(operator_name.msp_id);
  role.mutable_identity()->set_subject(operator_name.subject);
  role.set_role(OPERATOR);
  LeaseCall lease;
  for (const auto& drone : drones) {
    host.add_drones(drone);
    lease.add_drones(drone);
  }
  if (auto s = ledger.commit_now(0, admin1, {"enroll", {host.SerializeAsString()}}); !s) return s;
  if (auto s = ledger.commit_now(0, admin2, {"enroll", {role.SerializeAsString()}}); !s) return s;
  return ledger.commit_now(0, holder, {"acquire", {lease.SerializeAsString()}});
}

Result<std::string> control_record(VirtualLedger& ledger, VirtualLedger::Client client, const std::string& drone) {
  QueryCall query;
  query.set_id("control/" + drone);
  auto answer = ledger.evaluate(0, client, {"get", {query.SerializeAsString()}});
  if (!answer) return answer.error();
  Assets assets;
  if (!assets.ParseFromString(*answer) || assets.assets_size() != 1)
    return Error{"get control/" + drone + ": no record"};
  return assets.assets(0).msg_data();
}

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
    while (!ground_.done() && now_ < config_.longest_ns) {
      now_ += tick_ns;
      step_sim();
      ledger_.step(now_);
      step_agent();
      step_ground();
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
    return parameters;
  }
  static link::LinkSettings link_settings(const VirtualFlightConfig& config) {
    link::LinkSettings settings;
    settings.rate_hz = config.rate_hz;
    for (int k = 1; k <= config.drones; ++k) settings.drones.push_back({drone_name(k), static_cast<DroneNumber>(k)});
    return settings;
  }
  static agent::AgentConfig agent_config(const VirtualFlightConfig& config) {
    agent::AgentConfig agent;
    agent.seed = config.seed;
    for (int k = 1; k <= config.drones; ++k) agent.drones.push_back({static_cast<DroneNumber>(k), drone_name(k)});
    return agent;
  }
  static ground::FlightConfig ground_config(const VirtualFlightConfig& config, VirtualLedger& ledger) {
    ground::FlightConfig ground;
    for (int k = 1; k <= config.drones; ++k) ground.drones.push_back({drone_name(k), static_cast<DroneNumber>(k)});
    ground.shape = config.shape;
    ground.laps = config.laps;
    ground.controller.speed_mps = config.speed_mps;
    ground.self = operator_name;
    ground.believed = ledger.shared_registry();
    return ground;
  }

  Status set_up() {
    std::vector<std::string> names;
    for (const auto& drone : ground_.drones()) names.push_back(drone.name);
    if (auto s = prepare(ledger_, names); !s) return s;
    host_ = ledger_.add_client(drone_host);
    operator_ = ledger_.add_client(operator_name);
    for (const auto& name : names) {
      const auto record = control_record(ledger_, operator_, name);
      if (!record) return record.error();
      Control control;
      if (!control.ParseFromString(*record)) return Error{name + ": malformed control record"};
      agent_.set_control(control);
      if (auto s = ground_.set_control(*record); !s) return s;
    }
    tracking_.resize(names.size());
    return done;
  }

  void step_sim() {
    const auto& out = sim_.step(now_);
    for (const auto& datagram : out.datagrams) {
      digest_.put(datagram.bytes);
      to_link_.push_back(datagram);
    }
    for (const auto& pose : out.poses) {
      agent_.on_mocap(now_, pose.drone, {pose.stamp_ns, pose.position_m, yaw_from_quaternion(pose.orientation)},
                      agent_out_);
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
      const ground::Path path(config_.shape, {status.origin_m[0], status.origin_m[1]}, ground_side_m_);
      const double error = path.distance_m({truth.position_m[0], truth.position_m[1]});
      tracking_[i].sum2 += error * error;
      tracking_[i].max = std::max(tracking_[i].max, error);
      ++tracking_[i].count;
    }
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
      const auto& tracking = tracking_[i];
      const double rms = tracking.count ? std::sqrt(tracking.sum2 / static_cast<double>(tracking.count)) : 0;
      result.drones.push_back({reports[i].name, agent_.report(reports[i].number).two_way.quantiles_ms(),
                               reports[i].age_ms, rms, tracking.max, ground_.status(i).lap_s,
                               ground_.status(i).commands_sent, reports[i].plans.applied});
    }
    return result;
  }

  struct Tracking {
    double sum2 = 0, max = 0;
    std::uint64_t count = 0;
  };

  VirtualFlightConfig config_;
  VirtualLedger ledger_;
  sim::Simulator sim_;
  link::LinkCore link_;
  agent::AgentCore agent_;
  ground::FlightCore ground_;
  double ground_side_m_ = ground::FlightConfig{}.side_m;
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

  std::vector<Tracking> tracking_;
  Digester digest_;
};

}  // namespace

Result<VirtualFlightResult> fly_virtually(const VirtualFlightConfig& config) {
  if (config.drones < 1 || config.drones > max_drones) {
    return Error{fmt::format("{} drones asked for; 1 to {} can fly", config.drones, max_drones)};
  }
  return Flight(config).run();
}

}  // namespace ledgerline::hil
