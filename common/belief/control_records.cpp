#include "common/belief/control_records.hpp"

#include <fmt/format.h>

#include <chrono>
#include <thread>
#include <utility>

#include "common/base/log.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::belief {
namespace {
constexpr std::chrono::milliseconds try_again_after{100};
}

Result<Control> read_control(const std::string& drone, const Evaluate& evaluate) {
  QueryCall query;
  query.set_id("control/" + drone);
  const auto answer = evaluate({.function = contract::get, .args = {query.SerializeAsString()}});
  if (!answer) return Error{fmt::format("control/{}: {}", drone, answer.error().what)};
  Assets assets;
  Control control;
  if (auto status = parse_message(*answer, assets); !status) return status.error();
  if (assets.assets_size() != 1) return Error{drone + " is not enrolled: enroll it first (ledgerline-fly does)"};
  if (auto status = parse_message(assets.assets(0).msg_data(), control); !status) return status.error();
  if (control.drone() != drone) return Error{fmt::format("control/{} is the record of another", drone)};
  return control;
}

Result<std::vector<Control>> read_controls(const std::vector<std::string>& drones, const Evaluate& evaluate) {
  std::vector<Control> controls;
  for (const std::string& drone : drones) {
    auto control = read_control(drone, evaluate);
    if (!control) return control.error();
    controls.push_back(std::move(control).value());
  }
  return controls;
}

std::optional<std::vector<Control>> keep_reading_controls(const std::stop_token& stop,
                                                          const std::vector<std::string>& drones,
                                                          const Evaluate& evaluate) {
  while (!stop.stop_requested()) {
    auto controls = read_controls(drones, evaluate);
    if (controls) return std::move(controls).value();
    spdlog::warn("the control records cannot be read yet, no block is taken: {}", controls.error().what);
    std::this_thread::sleep_for(try_again_after);
  }
  return std::nullopt;
}

Result<ControlStart::Next> ControlStart::on_block(const fabric::Block& block) {
  if (known_) return Next::take;
  if (held_.size() >= max_held_) {
    return Error{fmt::format("the control records could not be read while {} blocks came: see the messages above",
                             held_.size())};
  }
  held_.push_back(block);
  return std::exchange(reading_, true) ? Next::hold : Next::read;
}

std::vector<fabric::Block> ControlStart::on_read() {
  known_ = true;
  return std::exchange(held_, {});
}

}  // namespace ledgerline::belief
