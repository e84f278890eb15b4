#pragma once
#include "sim/core/parameters.hpp"
#include "sim/core/world.hpp"

namespace ledgerline::sim {

/// What the flight controller shall fly, in the map frame.
struct VelocitySetpoint {
  Vector velocity = Vector::Zero();
  Vector acceleration = Vector::Zero();  ///< known in advance (moves along a path); zero for sticks
  double yaw_rate = 0;                   ///< counter-clockwise [rad/s]
};

/// Velocity -> acceleration (first order, limited) -> thrust and attitude -> torque: the cascade of every small
/// quadrotor (Mellinger and Kumar 2011 without the differential flatness). Pure.
Motors fly_velocity(const Parameters& parameters, const Body& body, const Vector& estimated_velocity,
                    const VelocitySetpoint& setpoint);

/// Attitude mode: sideways the setpoint's velocity is a lean, as full a one as SdkParameters::rc_full_mps is full, and
/// nothing slows the drone but the air; upward as fly_velocity. Pure.
Motors fly_attitude(const Parameters& parameters, const Body& body, const Vector& estimated_velocity,
                    const VelocitySetpoint& setpoint);

/// A body rate instead of an attitude: for flips.
Motors fly_rates(const Parameters& parameters, const Body& body, const Vector& rates, double thrust_by_weight);

}  // namespace ledgerline::sim
