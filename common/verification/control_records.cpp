#include "common/verification/control_records.hpp"

#include <fmt/format.h>

#include <utility>

#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::verification {

Status read_pages(const std::string& id, const Evaluate& evaluate, const std::function<Status(const Assets&)>& take) {
  QueryCall query;
  query.set_id(id);
  do {
    const auto answer = evaluate({.function = contract::get, .args = {query.SerializeAsString()}});
    if (!answer) return answer.error();
    Assets page;
    if (auto status = parse_message(*answer, page); !status) return status;
    // Each is the last id of its page, and ids come in their order: a peer that goes in circles is seen.
    if (!page.bookmark().empty() && page.bookmark() <= query.bookmark()) return Error{"the ledger's pages do not end"};
    if (auto status = take(page); !status) return status;
    query.set_bookmark(page.bookmark());
  } while (!query.bookmark().empty());
  return done;
}

Status read_all(const std::string& kind, const Evaluate& evaluate, const std::function<Status(const Asset&)>& take) {
  return read_pages(kind + "/*", evaluate, [&](const Assets& page) -> Status {
    for (const Asset& asset : page.assets()) {
      if (auto status = take(asset); !status) return status;
    }
    return done;
  });
}

Result<Control> read_control(const std::string& drone, const Evaluate& evaluate) {
  QueryCall query;
  query.set_id("control/" + drone);
  const auto answer = evaluate({.function = contract::get, .args = {query.SerializeAsString()}});
  if (!answer) return Error{fmt::format("control/{}: {}", drone, answer.error().message)};
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

Status keep_reading(const std::stop_token& stop, const std::function<Status()>& read, const TryWorld& world) {
  return retry(
      "the control records can be read (no block is taken before)",
      {.within_ns = max_controls_wait_ns, .first_pause_ns = 50 * ns_per_ms, .max_pause_ns = 500 * ns_per_ms},
      [&] { return stop.stop_requested(); }, read, world);
}

Result<std::vector<Control>> keep_reading_controls(const std::stop_token& stop, const std::vector<std::string>& drones,
                                                   const Evaluate& evaluate, const TryWorld& world) {
  std::vector<Control> read;
  const auto once = [&]() -> Status {
    auto controls = read_controls(drones, evaluate);
    if (!controls) return controls.error();
    read = std::move(controls).value();
    return done;
  };
  if (auto status = keep_reading(stop, once, world); !status) return status.error();
  return read;
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

void ControlStart::forget() {
  held_.clear();
  forgotten_ = true;
}

void ControlStart::restart() {
  held_.clear();
  reading_ = forgotten_ = false;
}

std::vector<fabric::Block> ControlStart::on_read() {
  known_ = true;
  return std::exchange(held_, {});
}

}  // namespace ledgerline::verification
