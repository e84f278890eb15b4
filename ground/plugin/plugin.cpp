#include "ground/plugin/plugin.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "common/base/text.hpp"
#include "ground/core/controller.hpp"
#include "ground/plugin/controller_plugin.h"

static_assert(LEDGERLINE_MAX_SETPOINTS == ledgerline::max_setpoints);

namespace ledgerline::ground {
namespace {

using Table = ledgerline_controller_v1;
constexpr std::size_t max_name = 64;
constexpr double progress_slack_m = 0.5;  // beyond the end, which a controller may overshoot by a step
constexpr double max_leap_m = 50;         // of the reference between two plans: more than any pause makes of it

/// Keeps the library loaded as long as anything of it is in use.
class Library {
 public:
  Library(void* handle, const Table* table, std::string file)
      : handle_(handle), table_(table), file_(std::move(file)), name_(printable(table->name, max_name)) {}
  ~Library() { ::dlclose(handle_); }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;
  const Table& table() const { return *table_; }
  /// "my.so (P controller)"
  std::string text() const { return fmt::format("{} ({})", file_, name_); }

 private:
  void* handle_;
  const Table* table_;
  std::string file_, name_;
};

double length_of(const std::vector<Waypoint>& waypoints) { return Path(waypoints, Eigen::Vector2d::Zero()).length_m(); }

class PluginFollower final : public Follower {
 public:
  PluginFollower(std::shared_ptr<const Library> library, void* controller, const FollowerTask& task,
                 const ControllerConfig& config)
      : library_(std::move(library)),
        controller_(controller),
        path_(task.waypoints, task.origin_m),
        height_m_(task.waypoints.front().height_m.value_or(config.height_m)),
        slowest_mps_(config.speed_mps),
        end_m_(std::numeric_limits<double>::infinity()) {
    for (const Waypoint& waypoint : task.waypoints)
      slowest_mps_ = std::min(slowest_mps_, waypoint.speed_mps.value_or(slowest_mps_));
  }
  ~PluginFollower() override {
    guarded("destroy", [this] { table().destroy(controller_); });
  }
  PluginFollower(const PluginFollower&) = delete;
  PluginFollower& operator=(const PluginFollower&) = delete;

  void start(TimeNs from_ns, double end_m) override {
    started_ = true;
    end_m_ = end_m;
    guarded("start", [&] { table().start(controller_, from_ns, end_m); });
  }
  void observe(const StateSample& state) override;
  bool ready() const override { return seen_; }
  std::vector<Setpoint> plan(std::uint64_t id, TimeNs first_ns, std::size_t count) override;

  double progress_m() const override { return progress_m_; }
  bool at_end() const override { return started_ && progress_m_ >= end_m_ - 1e-6; }
  double lap_m() const override { return path_.length_m(); }
  double length_to(std::size_t corner) const override { return path_.length_to(corner); }
  const Path& path() const override { return path_; }
  double start_height_m() const override { return height_m_; }
  double expected_s(int laps) const override { return laps * path_.length_m() / slowest_mps_; }
  Status check() const override { return check_; }

 private:
  const Table& table() const { return library_->table(); }
  template <typename Call>
  void guarded(const char* which, const Call& call);
  void wrong(const std::string& what) {
    if (check_) check_ = Error{fmt::format("the controller {}: {}", library_->text(), what)};
  }
  Status check_plan(const ledgerline_plan& plan, TimeNs first_ns, TimeNs last_ns) const;

  std::shared_ptr<const Library> library_;
  void* controller_;
  Path path_;
  double height_m_, slowest_mps_, end_m_;
  double progress_m_ = 0;
  TimeNs newest_ns_ = 0;
  bool started_ = false, seen_ = false;
  Status check_ = done;
};

template <typename Call>
void PluginFollower::guarded(const char* which, const Call& call) {
  try {
    call();
  } catch (...) {
    wrong(fmt::format("{}() threw an exception", which));
  }
}

void PluginFollower::observe(const StateSample& state) {
  if (state.stamp_ns <= newest_ns_ || state.pose_stamp_ns == 0) return;
  newest_ns_ = state.stamp_ns;
  seen_ = true;
  ledgerline_state shown{};
  shown.stamp_ns = state.stamp_ns;
  shown.pose_stamp_ns = state.pose_stamp_ns;
  for (std::size_t i = 0; i < 3; ++i) {
    shown.position_m[i] = state.position_m[i];
    shown.velocity_mps[i] = state.velocity_mps[i];
    shown.sent_mps[i] = static_cast<double>(state.sent_velocity_mps[i]);
  }
  shown.yaw_rad = state.yaw_rad;
  shown.sent_yaw_rate_radps = static_cast<double>(state.sent_yaw_rate_radps);
  shown.late_ns = state.playout_margin_ns;
  shown.braking = state.mode == FailsafeMode::brake ? 1 : 0;
  guarded("observe", [&] { table().observe(controller_, &shown); });
}

Status PluginFollower::check_plan(const ledgerline_plan& plan, TimeNs first_ns, TimeNs last_ns) const {
  if (plan.count == 0 || plan.count > max_setpoints)
    return Error{fmt::format("{} setpoints in a plan; 1 to {} may be", plan.count, max_setpoints)};
  TimeNs before_ns = first_ns - 1;
  for (std::uint32_t i = 0; i < plan.count; ++i) {
    const ledgerline_setpoint& setpoint = plan.setpoints[i];
    for (const double value :
         {setpoint.velocity_mps[0], setpoint.velocity_mps[1], setpoint.velocity_mps[2], setpoint.yaw_rate_radps}) {
      if (!(std::abs(value) <= static_cast<double>(absurd_speed)))
        return Error{fmt::format("setpoint {} has {}, which no drone can fly", i + 1, value)};
    }
    if (setpoint.at_ns <= before_ns && i == 0)
      return Error{fmt::format("its first setpoint is {:.3f} ms too early", to_ms(first_ns - setpoint.at_ns))};
    if (setpoint.at_ns <= before_ns) return Error{fmt::format("setpoint {} is not later than the one before", i + 1)};
    if (setpoint.at_ns > last_ns)
      return Error{fmt::format("setpoint {} is {:.3f} ms too late", i + 1, to_ms(setpoint.at_ns - last_ns))};
    before_ns = setpoint.at_ns;
  }
  // No farther than it can have got since the plan before: each lap's end is looked for along the way.
  const double max_m = std::min(end_m_, progress_m_ + max_leap_m);
  if (!(plan.progress_m >= 0 && plan.progress_m <= max_m + progress_slack_m))
    return Error{fmt::format("a progress of {} m; 0 to {} may be", plan.progress_m, max_m)};
  return done;
}

std::vector<Setpoint> PluginFollower::plan(std::uint64_t, TimeNs first_ns, std::size_t count) {
  if (!check_) return {};
  const std::size_t steps = std::clamp<std::size_t>(count, PathController::steps, max_setpoints);
  const TimeNs last_ns = first_ns + static_cast<TimeNs>(steps - 1) * PathController::step_ns;
  ledgerline_plan answer{};
  int refused = 0;
  guarded("plan", [&] { refused = table().plan(controller_, first_ns, last_ns, &answer); });
  if (refused != 0 || !check_) return {};
  if (const Status checked = check_plan(answer, first_ns, last_ns); !checked) {
    wrong(checked.error().message);
    return {};
  }
  progress_m_ = std::min(answer.progress_m, end_m_);
  std::vector<Setpoint> setpoints;
  for (std::uint32_t i = 0; i < answer.count; ++i) {
    const ledgerline_setpoint& from = answer.setpoints[i];
    Setpoint to;
    to.at_ns = from.at_ns;
    for (std::size_t k = 0; k < 3; ++k) to.velocity_mps[k] = static_cast<float>(from.velocity_mps[k]);
    to.yaw_rate_radps = static_cast<float>(from.yaw_rate_radps);
    setpoints.push_back(to);
  }
  return setpoints;
}

Result<std::unique_ptr<Follower>> make(const std::shared_ptr<const Library>& library, const FollowerTask& task,
                                       const ControllerConfig& config) {
  std::vector<ledgerline_waypoint> waypoints;
  for (const Waypoint& waypoint : task.waypoints) {
    const Eigen::Vector2d at = task.origin_m + waypoint.at_m;
    waypoints.push_back({at.x(), at.y(), waypoint.height_m.value_or(config.height_m),
                         std::min(config.speed_mps, waypoint.speed_mps.value_or(config.speed_mps))});
  }
  ledgerline_task given{};
  given.drone = task.drone.c_str();
  given.waypoints = waypoints.data();
  given.waypoint_count = static_cast<std::uint32_t>(waypoints.size());
  given.laps = static_cast<std::uint32_t>(task.laps);
  given.yaw_rad = task.yaw_rad;
  given.max_speed_mps = config.full_scale_mps;
  given.max_gain_mps2 = config.max_acceleration_mps2;
  given.max_vertical_mps = config.max_vertical_mps;
  given.pose_lost_ns = config.pose_lost_ns;
  void* controller = nullptr;
  try {
    controller = library->table().create(&given);
  } catch (...) {
    return Error{fmt::format("the controller {}: create() threw an exception", library->text())};
  }
  if (!controller)
    return Error{fmt::format("the controller {} does not fly {} ({:.1f} m a lap): create() gave nothing",
                             library->text(), task.drone, length_of(task.waypoints))};
  return std::unique_ptr<Follower>(std::make_unique<PluginFollower>(library, controller, task, config));
}

}  // namespace

Result<MakeFollower> load_controller(const std::string& file) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return Error{fmt::format("there is no file {}", file)};
  // A name without a slash would be looked for where the system's libraries are.
  void* handle = ::dlopen(std::filesystem::absolute(file).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle) {
    const char* why = ::dlerror();
    return Error{fmt::format("{} cannot be loaded: {}", file, why ? why : "no reason is given")};
  }
  using Entry = const Table* (*)();
  const auto entry = reinterpret_cast<Entry>(::dlsym(handle, "ledgerline_controller"));
  const Table* table = nullptr;
  std::string wrong;
  try {
    table = entry ? entry() : nullptr;
  } catch (...) {
    wrong = "threw an exception in ledgerline_controller()";
  }
  if (wrong.empty() && !table) {
    wrong = "is no controller: it has no ledgerline_controller() (ground/plugin/controller_plugin.h)";
  } else if (table && table->version != LEDGERLINE_CONTROLLER_VERSION) {
    wrong = fmt::format("is made for version {} of the interface, this program has version {}: build it again",
                        table->version, LEDGERLINE_CONTROLLER_VERSION);
  } else if (table &&
             (!table->name || !table->create || !table->start || !table->observe || !table->plan || !table->destroy)) {
    wrong = "lacks its name or one of create, start, observe, plan, destroy";
  }
  if (!wrong.empty()) {
    ::dlclose(handle);
    return Error{fmt::format("{} {}", file, wrong)};
  }
  const auto library = std::make_shared<const Library>(handle, table, file);
  return MakeFollower(
      [library](const FollowerTask& task, const ControllerConfig& config) { return make(library, task, config); });
}

}  // namespace ledgerline::ground
