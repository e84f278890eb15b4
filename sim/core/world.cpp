#include "sim/core/world.hpp"

#include <ode/ode.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <vector>

namespace ledgerline::sim {
namespace {

// Gusts change slowly (1 s): ten times a second of physics steps is plenty and saves the random numbers' cost.
constexpr int steps_per_gust = 10;
// A body that lies still with its motors off for this long is left out of the physics until something moves it.
constexpr int still_steps_to_sleep = 500;
constexpr double still_mps = 0.01;
// A jet 9 m below its drone is this wide; what is farther apart sideways is not asked.
constexpr double jet_reach_m = 2;
constexpr double turbulence_s = 0.1;  // [A] eddies of the jet's width at its speed
constexpr double no_jet_mps = 1e-3;

void start_ode() {
  // Once a process; ODE keeps its collision data per thread.
  static std::once_flag once;
  std::call_once(once, [] { dInitODE2(0); });
  dAllocateODEDataForThread(dAllocateMaskAll);
}

Vector to_vector(const dReal* v) { return {v[0], v[1], v[2]}; }

struct DroneBody {
  dBodyID body = nullptr;
  dGeomID geom = nullptr;
  Motors wanted;
  double thrust_n = 0;
  Vector wind = Vector::Zero();
  Vector jet = Vector::Zero(), eddy = Vector::Zero();  ///< from drones above; what of it comes and goes
  Vector last_velocity = Vector::Zero();
  int still_steps = 0;
  Body seen;
};

}  // namespace

struct World::State {
  explicit State(const Parameters& parameters)
      : p(parameters), random(parameters.seed ^ 0x77696e64), eddies(parameters.seed ^ 0x65646479) {}

  Parameters p;
  Random random, eddies;
  dWorldID world = nullptr;
  dThreadingImplementationID threading = nullptr;
  dGeomID ground = nullptr;
  dJointGroupID contacts = nullptr;
  std::vector<DroneBody> drones;
  std::uint64_t steps = 0;
  Vector steady_wind = Vector::Zero();

  void gusts();
  void forces(DroneBody& drone) const;
  RotorLoss below_others(const DroneBody& drone) const;
  void touch(dGeomID a, dGeomID b);
  void collide();
  void look(DroneBody& drone) const;
};

World::World(const Parameters& parameters) : state_(std::make_unique<State>(parameters)) {
  start_ode();
  State& s = *state_;
  s.world = dWorldCreate();
  // Its own: ODE's default one is shared by all worlds, which then must not step at once.
  s.threading = dThreadingAllocateSelfThreadedImplementation();
  dWorldSetStepThreadingImplementation(s.world, dThreadingImplementationGetFunctions(s.threading), s.threading);
  dWorldSetGravity(s.world, 0, 0, -gravity_mps2);
  dWorldSetERP(s.world, 0.2);
  dWorldSetCFM(s.world, 1e-6);
  dWorldSetContactSurfaceLayer(s.world, 0.0005);
  dWorldSetContactMaxCorrectingVel(s.world, 0.5);
  s.ground = dCreatePlane(nullptr, 0, 0, 1, 0);
  s.contacts = dJointGroupCreate(0);

  const BodyParameters& b = s.p.body;
  s.drones.resize(static_cast<std::size_t>(s.p.drones));
  for (std::size_t i = 0; i < s.drones.size(); ++i) {
    DroneBody& drone = s.drones[i];
    drone.body = dBodyCreate(s.world);
    dMass mass;
    dMassSetParameters(&mass, b.mass_kg, 0, 0, 0, b.inertia_xy_kgm2, b.inertia_xy_kgm2, b.inertia_z_kgm2, 0, 0, 0);
    dBodySetMass(drone.body, &mass);
    dBodySetGyroscopicMode(drone.body, 0);
    const auto start_m = start_of(s.p, static_cast<int>(i) + 1);
    dBodySetPosition(drone.body, start_m[0], start_m[1], b.height_m / 2);
    const dQuaternion looking{std::cos(s.p.start_yaw_rad / 2), 0, 0, std::sin(s.p.start_yaw_rad / 2)};
    dBodySetQuaternion(drone.body, looking);
    drone.geom = dCreateBox(nullptr, b.length_m, b.length_m, b.height_m);
    dGeomSetBody(drone.geom, drone.body);
    s.look(drone);
  }
}

World::~World() {
  for (const DroneBody& drone : state_->drones) dGeomDestroy(drone.geom);
  dGeomDestroy(state_->ground);
  dJointGroupDestroy(state_->contacts);
  dWorldDestroy(state_->world);
  dThreadingFreeImplementation(state_->threading);
}

int World::size() const { return static_cast<int>(state_->drones.size()); }

void World::set_motors(int drone, const Motors& motors) {
  state_->drones[static_cast<std::size_t>(drone)].wanted = motors;
}

const Body& World::body(int drone) const { return state_->drones[static_cast<std::size_t>(drone)].seen; }

Vector World::wind(int drone) const { return state_->drones[static_cast<std::size_t>(drone)].wind; }

void World::kick(int drone, const Vector& velocity) {
  const dBodyID body = state_->drones[static_cast<std::size_t>(drone)].body;
  const Vector v = to_vector(dBodyGetLinearVel(body)) + velocity;
  dBodyEnable(body);
  dBodySetLinearVel(body, v.x(), v.y(), v.z());
}

void World::set_wind(const Vector& velocity) { state_->steady_wind = velocity; }

void World::State::gusts() {
  const double dt = steps_per_gust * step_s;
  const double keep = std::exp(-dt / p.wind.gust_s);
  const double fresh = p.wind.gust_mps * std::sqrt(1 - keep * keep);
  for (DroneBody& drone : drones)
    for (int axis = 0; axis < 3; ++axis)
      drone.wind[axis] = keep * drone.wind[axis] + fresh * (axis == 2 ? 1.0 / 3 : 1.0) * random.normal();
  // Drawn only in a jet, so that drones that are never below another fly as they would without.
  const double lasts = std::exp(-dt / turbulence_s);
  for (DroneBody& drone : drones) {
    drone.eddy *= lasts;
    const double speed_mps = drone.jet.norm();
    if (speed_mps < no_jet_mps) continue;
    const double new_mps = p.air.turbulence * speed_mps * std::sqrt(1 - lasts * lasts);
    for (int axis = 0; axis < 3; ++axis) drone.eddy[axis] += new_mps * eddies.normal();
  }
}

RotorLoss World::State::below_others(const DroneBody& drone) const {
  const auto is_above = [&](const DroneBody& other) {
    const Vector from = other.seen.position - drone.seen.position;
    return &other != &drone && other.thrust_n > 0 && from.z() > 0 &&
           from.head<2>().squaredNorm() < jet_reach_m * jet_reach_m;
  };
  if (p.air.jet_mps <= 0 || std::none_of(drones.begin(), drones.end(), is_above)) return {};
  return rotor_loss(p, drone.seen, drone.thrust_n, [&](const Vector& at) {
    Vector air = drone.eddy;
    for (const DroneBody& other : drones)
      if (is_above(other)) air += downwash(p, other.seen, other.thrust_n, at);
    return air;
  });
}

void World::State::forces(DroneBody& drone) const {
  const BodyParameters& b = p.body;
  const double wanted = std::clamp(drone.wanted.thrust_n, 0.0, b.max_thrust_by_weight * b.mass_kg * gravity_mps2);
  drone.thrust_n += (wanted - drone.thrust_n) * step_s / b.motor_lag_s;
  if (drone.wanted.thrust_n <= 0 && drone.thrust_n < 1e-4) drone.thrust_n = 0;

  const bool running = drone.thrust_n > 0;
  if (running) {
    dBodyEnable(drone.body);
    drone.still_steps = 0;
  } else if (dBodyIsEnabled(drone.body)) {
    const bool still =
        drone.seen.touching && drone.seen.velocity.norm() < still_mps && drone.seen.rates.norm() < 10 * still_mps;
    drone.still_steps = still ? drone.still_steps + 1 : 0;
    if (drone.still_steps > still_steps_to_sleep) dBodyDisable(drone.body);
  }
  if (!dBodyIsEnabled(drone.body)) return;

  const RotorLoss loss = running ? below_others(drone) : RotorLoss{};
  drone.jet = loss.air;
  const Vector through_air = drone.seen.velocity - drone.wind - steady_wind - loss.air;
  const Vector drag = -b.mass_kg * Vector(b.drag_xy_per_s * through_air.x(), b.drag_xy_per_s * through_air.y(),
                                          b.drag_z_per_s * through_air.z());
  // Wind pushes what flies; what stands with its motors off is held by the ground.
  if (running) dBodyAddForce(drone.body, drag.x(), drag.y(), drag.z());
  const double lift_n = (drone.thrust_n - loss.thrust_n) * ground_effect(p, drone.seen.position.z() + b.height_m);
  dBodyAddRelForce(drone.body, 0, 0, lift_n);
  const Vector inertia(b.inertia_xy_kgm2, b.inertia_xy_kgm2, b.inertia_z_kgm2);
  const Vector torque =
      drone.wanted.torque_nm + loss.torque_nm - b.drag_angular_per_s * inertia.cwiseProduct(drone.seen.rates);
  dBodyAddRelTorque(drone.body, torque.x(), torque.y(), torque.z());
}

void World::State::touch(dGeomID a, dGeomID b) {
  constexpr int most = 4;
  std::array<dContactGeom, most> found;
  const int count = dCollide(a, b, most, found.data(), sizeof(dContactGeom));
  for (int i = 0; i < count; ++i) {
    dContact contact{};
    contact.surface.mode = dContactBounce | dContactApprox1;
    contact.surface.mu = p.body.ground_friction;
    contact.surface.bounce = p.body.ground_restitution;
    contact.surface.bounce_vel = 0.1;
    contact.geom = found[static_cast<std::size_t>(i)];
    dJointAttach(dJointCreateContact(world, contacts, &contact), dGeomGetBody(a), dGeomGetBody(b));
  }
  if (count > 0)
    for (DroneBody& drone : drones)
      if (drone.geom == a || drone.geom == b) drone.seen.touching = true;
}

void World::State::collide() {
  const double reach = p.body.length_m * std::sqrt(2.0) + p.body.height_m;
  for (std::size_t i = 0; i < drones.size(); ++i) {
    DroneBody& drone = drones[i];
    const bool awake = dBodyIsEnabled(drone.body) != 0;
    if (awake) drone.seen.touching = false;
    if (awake && drone.seen.position.z() < reach) touch(drone.geom, ground);
  }
  for (std::size_t i = 0; i < drones.size(); ++i) {
    for (std::size_t k = i + 1; k < drones.size(); ++k) {
      if ((drones[i].seen.position - drones[k].seen.position).squaredNorm() > reach * reach) continue;
      if (!dBodyIsEnabled(drones[i].body) && !dBodyIsEnabled(drones[k].body)) continue;
      touch(drones[i].geom, drones[k].geom);
    }
  }
}

void World::State::look(DroneBody& drone) const {
  const dReal* q = dBodyGetQuaternion(drone.body);
  drone.seen.attitude = Rotation(q[0], q[1], q[2], q[3]);
  drone.seen.velocity = to_vector(dBodyGetLinearVel(drone.body));
  drone.seen.position = to_vector(dBodyGetPosition(drone.body)) - Vector(0, 0, p.body.height_m / 2);
  const Rotation to_body = drone.seen.attitude.conjugate();
  drone.seen.rates = to_body * to_vector(dBodyGetAngularVel(drone.body));
  const Vector acceleration = (drone.seen.velocity - drone.last_velocity) / step_s;
  drone.seen.specific_force = to_body * (acceleration + Vector(0, 0, gravity_mps2));
  drone.last_velocity = drone.seen.velocity;
}

void World::step() {
  State& s = *state_;
  if (s.steps++ % steps_per_gust == 0) s.gusts();
  for (DroneBody& drone : s.drones) s.forces(drone);
  s.collide();
  dWorldStep(s.world, step_s);
  dJointGroupEmpty(s.contacts);
  for (DroneBody& drone : s.drones)
    if (dBodyIsEnabled(drone.body)) s.look(drone);
}

double yaw_of(const Rotation& q) {
  return std::atan2(2 * (q.w() * q.z() + q.x() * q.y()), 1 - 2 * (q.y() * q.y() + q.z() * q.z()));
}

double tilt_of(const Rotation& q) { return std::acos(std::clamp(1 - 2 * (q.x() * q.x() + q.y() * q.y()), -1.0, 1.0)); }

namespace {

constexpr double farthest_radii = 3;        // beyond it there is nothing left of the jet
constexpr double max_ground_effect = 1.25;  // on the ground the formula knows no bound
constexpr double ground_effect_ends_m = 1;  // less than a thousandth is left

}  // namespace

Vector downwash(const Parameters& parameters, const Body& above, double thrust_n, const Vector& at) {
  const AirParameters& air = parameters.air;
  if (air.jet_mps <= 0 || thrust_n <= 0) return Vector::Zero();
  const Vector axis = -(above.attitude * Vector::UnitZ());
  const Vector from = at - above.position;
  const double along_m = from.dot(axis);
  if (along_m <= 0) return Vector::Zero();
  const double widening = std::max(1.0, along_m / air.jet_core_m);
  const double radius_m = air.jet_radius_m * widening;
  const double off_m = (from - along_m * axis).norm();
  if (off_m > farthest_radii * radius_m) return Vector::Zero();
  const double hover_n = parameters.body.mass_kg * gravity_mps2;
  const double speed_mps = air.jet_mps * std::sqrt(thrust_n / hover_n) / widening;
  return speed_mps * std::exp(-(off_m / radius_m) * (off_m / radius_m)) * axis;
}

double ground_effect(const Parameters& parameters, double height_m) {
  const double radius_m = parameters.air.ground_effect_radius_m;
  if (radius_m <= 0 || height_m > ground_effect_ends_m) return 1;
  const double x = radius_m / (4 * std::max(height_m, radius_m / 4));
  return x * x >= 1 - 1 / max_ground_effect ? max_ground_effect : 1 / (1 - x * x);
}

}  // namespace ledgerline::sim
