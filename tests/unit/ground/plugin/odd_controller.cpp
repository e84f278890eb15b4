// A controller that says what no controller should: which nonsense, the drone's name says.
#include <cmath>
#include <stdexcept>
#include <string>

#include "ground/plugin/controller_plugin.h"

#ifndef ODD_VERSION
#define ODD_VERSION LEDGERLINE_CONTROLLER_VERSION
#endif

namespace {

void* create(const ledgerline_task* task) {
  const std::string drone = task->drone;
  if (drone == "throws in create") throw std::runtime_error("no");
  return drone == "refuses" ? nullptr : new std::string(drone);
}

void start(void* controller, int64_t, double) {
  if (*static_cast<std::string*>(controller) == "throws in start") throw std::runtime_error("no");
}

void observe(void* controller, const ledgerline_state*) {
  if (*static_cast<std::string*>(controller) == "throws in observe") throw std::runtime_error("no");
}

int plan(void* controller, int64_t first_ns, int64_t last_ns, ledgerline_plan* plan) {
  const std::string& odd = *static_cast<std::string*>(controller);
  if (odd == "throws in plan") throw 1;
  plan->count = 2;
  plan->setpoints[0] = {first_ns, {0.1, 0.2, 0.3}, 0.4};
  plan->setpoints[1] = {last_ns, {0, 0, 0}, 0};
  plan->progress_m = 1.25;
  if (odd == "nan") plan->setpoints[1].velocity_mps[2] = std::nan("");
  if (odd == "absurd") plan->setpoints[0].yaw_rate_radps = 1e9;
  if (odd == "none") plan->count = 0;
  if (odd == "too many") plan->count = 41;
  if (odd == "too early") plan->setpoints[0].at_ns -= 1'000'000;
  if (odd == "too late") plan->setpoints[1].at_ns += 1'000'000;
  if (odd == "twice") plan->setpoints[1].at_ns = first_ns;
  if (odd == "progress is nan") plan->progress_m = std::nan("");
  if (odd == "goes back") plan->progress_m = -1;
  if (odd == "beyond") plan->progress_m = 100;
  if (odd == "endless") plan->progress_m = INFINITY;
  return odd == "silent" ? 1 : 0;
}

void destroy(void* controller) { delete static_cast<std::string*>(controller); }

constexpr ledgerline_controller_v1 table{ODD_VERSION, "odd \x1b[31m", create, start, observe, plan,
#ifdef ODD_LACKS
                                         nullptr
#else
                                         destroy
#endif
};

}  // namespace

const ledgerline_controller_v1* ledgerline_controller(void) { return &table; }
