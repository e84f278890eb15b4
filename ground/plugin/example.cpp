// A controller of one's own, whole: build it as a shared library and fly it.
//
//     g++ -std=c++20 -O2 -shared -fPIC -I LEDGERLINE example.cpp -o my.so
//     ledgerline fault run hil/scenarios/own/plugin-slow-ledger.toml --controller my.so --seeds 1..100
//
// A reference moves along the path, and the drone is steered to it: the reference's velocity and a share of the way
// that is missing, for the place where the drone will be when the plan takes effect. How fast it is now this controller
// takes from two poses, so it works beside a pose source that reports no velocity.
//
// A usual mistake: to use the newest state's stamp twice. Set reference_ns_ to pose_ns_ in place of first_ns, and the
// scenario catches it.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "ground/plugin/controller_plugin.h"

namespace {

using Vector = std::array<double, 3>;

constexpr double gain_per_s = 1.0;    // of the way that is missing; more than 1 / (lag + age) would swing
constexpr double yaw_gain_per_s = 1;  // the same of the heading
constexpr double lag_s = 0.3;         // until a Tello flies what it is sent
constexpr double leash_m = 1.0;       // the reference waits for a drone that is farther behind
constexpr int64_t step_ns = 50'000'000;
constexpr uint32_t steps = 12;  // 0.6 s: so long may the next plan be away

double seconds(int64_t ns) { return 1e-9 * static_cast<double>(ns); }

double distance(const Vector& a, const Vector& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

class Controller {
 public:
  explicit Controller(const ledgerline_task& task)
      : corners_(task.waypoints, task.waypoints + task.waypoint_count),
        yaw_rad_(task.yaw_rad),
        max_speed_mps_(task.max_speed_mps),
        max_vertical_mps_(task.max_vertical_mps) {
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const ledgerline_waypoint &a = corners_[i], &b = corners_[(i + 1) % corners_.size()];
      lengths_m_.push_back(std::hypot(b.x_m - a.x_m, b.y_m - a.y_m));
      lap_m_ += lengths_m_.back();
    }
  }

  void start(int64_t from_ns, double end_m) {
    started_ = true;
    reference_ns_ = from_ns;
    end_m_ = end_m;
  }

  void observe(const ledgerline_state& state) {
    const Vector at{state.position_m[0], state.position_m[1], state.position_m[2]};
    yaw_now_rad_ = state.yaw_rad;
    const int64_t stamp_ns = state.pose_stamp_ns;  // a state may repeat a pose: then nothing is new
    if (stamp_ns <= pose_ns_) return;
    if (pose_ns_ > 0) {
      for (std::size_t i = 0; i < 3; ++i) velocity_mps_[i] = (at[i] - at_m_[i]) / seconds(stamp_ns - pose_ns_);
    }
    at_m_ = at;
    pose_ns_ = stamp_ns;
  }

  int plan(int64_t first_ns, int64_t last_ns, ledgerline_plan& plan) {
    if (pose_ns_ == 0) return 1;
    Vector at = at_m_, velocity = velocity_mps_;
    const double ahead_s = std::clamp(seconds(first_ns - pose_ns_), 0.0, 0.5);
    for (std::size_t i = 0; i < 3; ++i) at[i] += ahead_s * velocity[i];
    if (started_ && first_ns > reference_ns_) {
      progress_m_ = advance(progress_m_, at, std::min(seconds(first_ns - reference_ns_), 0.5));
      reference_ns_ = first_ns;
    }
    double progress_m = progress_m_;
    plan.count = 0;
    plan.progress_m = progress_m_;
    for (int64_t at_ns = first_ns; plan.count < steps && at_ns <= last_ns; at_ns += step_ns) {
      const double dt_s = seconds(step_ns);
      const double next_m = started_ ? advance(progress_m, at, dt_s) : progress_m;
      ledgerline_setpoint& setpoint = plan.setpoints[plan.count++];
      setpoint.at_ns = at_ns;
      steer(at, progress_m, (next_m - progress_m) / dt_s, setpoint);
      for (std::size_t i = 0; i < 3; ++i) {
        velocity[i] += (setpoint.velocity_mps[i] - velocity[i]) * dt_s / lag_s;
        at[i] += velocity[i] * dt_s;
      }
      progress_m = next_m;
    }
    return 0;
  }

 private:
  // The piece that this place of the path is on, and how far along it.
  std::size_t piece_at(double& s_m) const {
    s_m = std::fmod(s_m, lap_m_);
    std::size_t i = 0;
    while (i + 1 < lengths_m_.size() && s_m >= lengths_m_[i]) s_m -= lengths_m_[i++];
    return i;
  }

  Vector place(double s_m) const {
    const std::size_t i = piece_at(s_m);
    const ledgerline_waypoint &a = corners_[i], &b = corners_[(i + 1) % corners_.size()];
    const double share = s_m / lengths_m_[i];
    return {a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m), a.z_m + share * (b.z_m - a.z_m)};
  }

  double advance(double s_m, const Vector& drone, double dt_s) const {
    const double share = std::clamp(2 - 2 * distance(place(s_m), drone) / leash_m, 0.0, 1.0);
    double on_piece_m = s_m;
    const double speed_mps = corners_[piece_at(on_piece_m)].speed_mps;
    return std::min(end_m_, s_m + share * speed_mps * dt_s);
  }

  void steer(const Vector& drone, double s_m, double speed_mps, ledgerline_setpoint& setpoint) const {
    const double then_m = s_m + lag_s * speed_mps;  // where the reference is when the drone flies what it is sent now
    const Vector goal = place(s_m), from = place(then_m), to = place(then_m + 0.01);
    Vector wanted{};
    for (std::size_t i = 0; i < 3; ++i)
      wanted[i] = speed_mps * (to[i] - from[i]) / 0.01 + gain_per_s * (goal[i] - drone[i]);
    if (const double level_mps = std::hypot(wanted[0], wanted[1]); level_mps > max_speed_mps_) {
      wanted[0] *= max_speed_mps_ / level_mps;
      wanted[1] *= max_speed_mps_ / level_mps;
    }
    wanted[2] = std::clamp(wanted[2], -max_vertical_mps_, max_vertical_mps_);
    std::copy(wanted.begin(), wanted.end(), setpoint.velocity_mps);
    const double turn_rad = std::remainder(yaw_rad_ - yaw_now_rad_, 2 * 3.14159265358979);
    setpoint.yaw_rate_radps = std::clamp(yaw_gain_per_s * turn_rad, -0.5, 0.5);
  }

  std::vector<ledgerline_waypoint> corners_;
  std::vector<double> lengths_m_;
  double lap_m_ = 0, yaw_rad_, max_speed_mps_, max_vertical_mps_;
  double yaw_now_rad_ = 0;
  Vector at_m_{}, velocity_mps_{};
  int64_t pose_ns_ = 0;
  bool started_ = false;
  int64_t reference_ns_ = 0;
  double progress_m_ = 0, end_m_ = 0;
};

Controller& of(void* controller) { return *static_cast<Controller*>(controller); }

void* create(const ledgerline_task* task) { return new Controller(*task); }
void start(void* controller, int64_t from_ns, double end_m) { of(controller).start(from_ns, end_m); }
void observe(void* controller, const ledgerline_state* state) { of(controller).observe(*state); }
int plan(void* controller, int64_t first_ns, int64_t last_ns, ledgerline_plan* plan) {
  return of(controller).plan(first_ns, last_ns, *plan);
}
void destroy(void* controller) { delete &of(controller); }

constexpr ledgerline_controller_v1 table{
    LEDGERLINE_CONTROLLER_VERSION, "example: P along the path", create, start, observe, plan, destroy};

}  // namespace

const ledgerline_controller_v1* ledgerline_controller(void) { return &table; }
