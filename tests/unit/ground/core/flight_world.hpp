#pragma once
#include <map>
#include <string>
#include <vector>

#include "common/msg/ros.hpp"
#include "ground/core/flight.hpp"
#include "ledgerline.pb.h"
#include "tests/unit/ground/core/lagged_drone.hpp"

namespace ledgerline::ground {

inline const crypto::IdentityName host_name{"Org1MSP", "CN=User1@org1"};
inline const crypto::IdentityName operator_name{"Org2MSP", "CN=User1@org2"};
inline const crypto::IdentityName outsider_name{"Org3MSP", "CN=User1@org3"};

inline Stop stop_of(const std::string& drone, const crypto::IdentityName& stopper, bool cut = false) {
  Stop stop;
  stop.set_drone(drone);
  stop.mutable_stopper()->set_msp_id(stopper.msp_id);
  stop.mutable_stopper()->set_subject(stopper.subject);
  stop.set_cut(cut);
  return stop;
}

inline Control control_record(const std::string& drone, const crypto::IdentityName& holder, std::uint64_t epoch = 1) {
  Control control;
  control.set_drone(drone);
  control.mutable_owner()->set_msp_id(host_name.msp_id);
  control.mutable_owner()->set_subject(host_name.subject);
  control.mutable_holder()->set_msp_id(holder.msp_id);
  control.mutable_holder()->set_subject(holder.subject);
  control.set_epoch(epoch);
  for (const char* msp_id : {"Org2MSP", "Org3MSP"}) {
    Grant& grant = *control.add_grants();
    grant.mutable_to()->set_msp_id(msp_id);
    grant.set_fly(true);
    grant.set_max_priority(99);
  }
  return control;
}

/// Of a drone that somebody of our organisation holds, and lets us command.
inline Control delegated_record(const std::string& drone, const std::string& holder, std::uint64_t epoch = 1) {
  Control control = control_record(drone, {operator_name.msp_id, holder}, epoch);
  control.mutable_delegate()->set_msp_id(operator_name.msp_id);
  control.mutable_delegate()->set_subject(operator_name.subject);
  return control;
}

inline FlightConfig config_for(int drones) {
  FlightConfig config;
  for (int k = 1; k <= drones; ++k) config.drones.push_back({"tello" + std::to_string(k), static_cast<DroneNumber>(k)});
  config.self = operator_name;
  config.laps = 1;
  return config;
}

inline fabric::Transaction event(const std::string& name, std::string payload) {
  fabric::Transaction tx;
  tx.code = 0;
  tx.channel = "teleop";
  tx.contract = "ledgerline";
  tx.function = name;
  tx.args = {payload};
  tx.event_name = name;
  tx.event_payload = std::move(payload);
  return tx;
}

/// A control event whose creator asked for these drones.
inline fabric::Transaction control_event(const std::string& name, const std::vector<std::string>& drones,
                                         std::string payload, bool cut = false) {
  fabric::Transaction tx = event(name, std::move(payload));
  tx.args = drones;
  if (cut) tx.args.emplace_back("cut=true");
  return tx;
}

/// Adds a state as agent does: odometry, where it has a pose, before the status.
inline void add_state(SetCall& call, const std::string& drone, const StateSample& sample) {
  const auto add = [&](const std::string& id, std::string_view type, std::string cdr) {
    Asset& asset = *call.add_assets();
    asset.set_id(drone + id);
    asset.set_msg_type(std::string(type));
    asset.set_msg_data(std::move(cdr));
  };
  if (sample.pose_stamp_ns != 0) add("/odom", odometry_type, to_cdr(odometry_of(sample, drone, 0)));
  add("/link", link_status_type, link_status_to_cdr(sample, 0));
}

/// Drones that take off, fly and land, and a ledger that takes its time, around a FlightCore: 30 states a second, each
/// batch and each command in a block of its own, `one_way_ns` later. Tests switch parts of it off.
class FlightWorld {
 public:
  explicit FlightWorld(FlightConfig config) : core(config) {
    for (const FlightDrone& drone : config.drones) {
      drones.push_back({});
      drones.back().name = drone.name;
      drones.back().model.motion.position_m = {3.0 * static_cast<double>(drones.size() - 1), 1, 0};
      (void)core.set_control(control_record(drone.name, operator_name).SerializeAsString());
    }
  }

  struct Drone {
    std::string name;
    LaggedDrone model{0.3};
    LinkPhase phase = LinkPhase::on_ground;
    TimeNs phase_since_ns = 0;
    std::uint64_t boot_id = 7, sequence = 0;
    FailsafeMode mode = FailsafeMode::none;
    FailsafeCause cause = FailsafeCause::none;
    bool obeys_takeoff = true, obeys_landing = true, silent = false, has_pose = true;
    TimeNs pose_late_ns = 0;       ///< so old is its pose
    float sigma_m = 0;             ///< of x alone
    std::vector<DronePlan> plans;  ///< as they came
    TimeNs arrived_ns = 0;         ///< the newest of them
  };

  /// Runs until the flight is done, or for at most `limit_s`.
  void run(double limit_s, std::string land = "", double land_at_s = 0) {
    const TimeNs until_ns = now_ns + from_seconds(limit_s);
    const TimeNs land_ns = now_ns + from_seconds(land_at_s);
    for (; now_ns < until_ns && !core.done(); now_ns += ns_per_ms) {
      if (now_ns >= next_batch_ns) send_batch();
      FlightInputs inputs;
      if (!land.empty() && now_ns >= land_ns) inputs.land = std::exchange(land, "");
      if (now_ns % (20 * ns_per_ms) == 0 || !inputs.land.empty()) give(inputs);
      while (!blocks_.empty() && blocks_.front().first <= now_ns) {
        const fabric::Block block = std::move(blocks_.front().second);
        blocks_.pop_front();
        for (const auto& tx : block.transactions) {
          if (tx.event_name == "command") deliver(tx.event_payload);
        }
        FlightInputs with_block;
        with_block.block = &block;
        give(with_block);
      }
      while (!outcomes_.empty() && outcomes_.front().at_ns <= now_ns) {
        const Ended ended = std::move(outcomes_.front());
        outcomes_.pop_front();
        FlightInputs with_outcome;
        with_outcome.outcome = &ended.outcome;
        with_outcome.outcome_id = ended.id;
        give(with_outcome);
      }
      for (Drone& drone : drones) move(drone);
    }
  }

  /// The pilot's words, with the core's next step, which is now.
  void say(PilotCommand command) {
    command.came_ns = now_ns;
    FlightInputs inputs;
    inputs.commands = {&command, 1};
    give(inputs);
  }

  void put_block(fabric::Transaction tx) {
    fabric::Block block;
    block.number = height++;
    block.transactions.push_back(std::move(tx));
    blocks_.push_back({now_ns + one_way_ns, std::move(block)});
  }

  FlightCore core;
  std::vector<Drone> drones;
  TimeNs now_ns = 1'000 * ns_per_s;
  TimeNs one_way_ns = 5 * ns_per_ms;
  TimeNs next_batch_ns = 0;
  std::uint64_t height = 1;
  std::vector<TraceRecord> traces;
  std::vector<CommandCall> calls;
  std::size_t updates = 0;  ///< with odometry
  std::vector<std::string> notes, diagnoses;
  std::vector<std::string> unheard;  ///< FlightInputs::unheard
  std::vector<DronesCall> stops;     ///< as they were submitted
  bool all_stops_urgent = true;
  fabric::Outcome::Kind end_of_stops = fabric::Outcome::Kind::committed;

 private:
  struct Ended {
    TimeNs at_ns;
    std::uint64_t id;
    fabric::Outcome outcome;
  };

  void give(FlightInputs inputs) {
    inputs.unheard = unheard;
    FlightOutputs out = core.step(now_ns, inputs);
    traces.insert(traces.end(), out.traces.begin(), out.traces.end());
    for (const DroneUpdate& one : out.updates) updates += one.odometry.empty() ? 0 : 1;
    for (const DroneUpdate& one : out.diagnoses) diagnoses.push_back(one.diagnosis);
    notes.insert(notes.end(), out.notes.begin(), out.notes.end());
    for (const Submission& submission : out.submissions) {
      if (submission.call.function == "stop") {
        take_stop(submission);
        continue;
      }
      CommandCall call;
      call.ParseFromString(submission.call.args.at(0));
      calls.push_back(call);
      put_block(event("command", submission.call.args.at(0)));
      fabric::Outcome outcome;
      outcome.kind = fabric::Outcome::Kind::committed;
      outcomes_.push_back({now_ns + one_way_ns + ns_per_ms, submission.id, outcome});
    }
  }

  void take_stop(const Submission& submission) {
    all_stops_urgent = all_stops_urgent && submission.urgent;
    stops.emplace_back();
    stops.back().ParseFromString(submission.call.args.at(0));
    outcomes_.push_back({now_ns + one_way_ns + ns_per_ms, submission.id,
                         fabric::Outcome::failed(end_of_stops, "chaincode response 500, as the test wants it")});
    if (end_of_stops != fabric::Outcome::Kind::committed) return;
    Stops event_of_stop;
    for (const std::string& name : stops.back().drones()) {
      *event_of_stop.add_stops() = stop_of(name, operator_name, stops.back().cut());
      for (Drone& drone : drones) {
        if (drone.name == name && is_in_flight(drone.phase)) enter(drone, LinkPhase::landing);
      }
    }
    const std::vector<std::string> asked(stops.back().drones().begin(), stops.back().drones().end());
    put_block(control_event("stop", asked, event_of_stop.SerializeAsString(), stops.back().cut()));
  }

  void send_batch() {
    next_batch_ns = std::max(next_batch_ns, now_ns) + ns_per_s / 30;
    SetCall call;
    for (Drone& drone : drones) {
      if (drone.silent) continue;
      StateSample sample;
      sample.phase = drone.phase;
      sample.mode = drone.mode;
      sample.cause = drone.cause;
      sample.boot_id = drone.boot_id;
      sample.sequence = ++drone.sequence;
      sample.stamp_ns = now_ns;
      sample.pose_stamp_ns = drone.has_pose ? now_ns - drone.pose_late_ns : 0;
      for (int i = 0; i < 3; ++i) {
        sample.position_m[static_cast<std::size_t>(i)] = drone.model.motion.position_m[i];
        sample.velocity_mps[static_cast<std::size_t>(i)] = drone.model.motion.velocity_mps[i];
      }
      sample.yaw_rad = drone.model.motion.yaw_rad;
      sample.pose_variance[0] = drone.sigma_m * drone.sigma_m;
      for (std::size_t i = 0; i < 3; ++i)
        sample.sent_velocity_mps[i] = static_cast<float>(drone.model.setpoint_mps[static_cast<int>(i)]);
      if (!drone.plans.empty()) sample.arrived_sequence = drone.plans.back().sequence();
      sample.arrived_ns = drone.arrived_ns;
      for (const DronePlan& plan : drone.plans) {
        if (plan.action() != FLY || plan.setpoints(0).at_ns() > now_ns) continue;
        sample.applied_sequence = plan.sequence();
      }
      add_state(call, drone.name, sample);
    }
    if (!call.assets().empty()) put_block(event("set", call.SerializeAsString()));
  }

  void deliver(const std::string& payload) {
    CommandCall call;
    call.ParseFromString(payload);
    for (const DronePlan& plan : call.plans()) {
      for (Drone& drone : drones) {
        if (drone.name != plan.drone()) continue;
        drone.plans.push_back(plan);
        drone.arrived_ns = now_ns;
        if (plan.action() == TAKEOFF && !is_in_flight(drone.phase) && drone.obeys_takeoff) {
          enter(drone, LinkPhase::taking_off);
        } else if (plan.action() == LAND && drone.phase == LinkPhase::flying && drone.obeys_landing) {
          enter(drone, LinkPhase::landing);
        } else if (plan.action() == FLY) {
          std::vector<Setpoint> setpoints;
          for (const auto& p : plan.setpoints())
            setpoints.push_back({p.at_ns(), {p.vx(), p.vy(), p.vz()}, p.yaw_rate()});
          drone.model.deliver(now_ns, std::move(setpoints));
        }
      }
    }
  }

  void enter(Drone& drone, LinkPhase phase) {
    drone.phase = phase;
    drone.phase_since_ns = now_ns;
  }

  void move(Drone& drone) {
    Motion& motion = drone.model.motion;
    const TimeNs in_phase_ns = now_ns - drone.phase_since_ns;
    if (drone.phase == LinkPhase::flying) {
      drone.model.run_until(now_ns);
      return;
    }
    motion.stamp_ns = now_ns;
    motion.velocity_mps.setZero();
    if (drone.phase == LinkPhase::taking_off) {
      motion.position_m.z() = std::min(0.8, 0.4 * to_seconds(in_phase_ns));
      if (in_phase_ns > 3 * ns_per_s) enter(drone, LinkPhase::flying);
    } else if (drone.phase == LinkPhase::landing && in_phase_ns > 2 * ns_per_s) {
      motion.position_m.z() = 0;
      enter(drone, LinkPhase::landed);
    }
  }

  std::deque<std::pair<TimeNs, fabric::Block>> blocks_;
  std::deque<Ended> outcomes_;
};

}  // namespace ledgerline::ground
