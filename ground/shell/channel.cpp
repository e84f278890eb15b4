#include "ground/shell/channel.hpp"

#include <utility>

namespace ledgerline::ground {
namespace {

std::vector<std::string> names_of(const FlightCore& core) {
  std::vector<std::string> names;
  for (const FlightDrone& drone : core.drones()) names.push_back(drone.name);
  return names;
}

}  // namespace

Channel::Channel(Parts parts, std::string label, Put put)
    : core_(std::move(parts.flight)),
      names_(names_of(core_)),
      label_(std::move(label)),
      put_(std::move(put)),
      client_(std::move(parts.client)),
      urgent_(std::move(parts.urgent)),
      blocks_({.label = label_, .kept = std::move(parts.kept)}) {}

void Channel::open_stream() {
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [this](const fabric::Block& block, std::string_view) { put_(block); };
  blocks_.open(*client_, std::move(handlers));
}

void Channel::close() {
  control_reader_ = {};
  blocks_.close();
  urgent_.reset();
  client_.reset();
}

Status Channel::read_controls() {
  const auto controls =
      verification::read_controls(names_, [this](const fabric::Call& c) { return client_->evaluate(c); });
  if (!controls) return Error{label_ + controls.error().message};
  return set_controls(*controls);
}

Status Channel::set_controls(const std::vector<Control>& controls) {
  for (const Control& control : controls) {
    if (auto status = core_.set_control(control.SerializeAsString()); !status) return status;
  }
  return done;
}

Result<bool> Channel::on_block(const fabric::Block& block) {
  const auto next = control_start_.on_block(block);
  if (!next) return Error{label_ + next.error().message};
  if (*next == verification::ControlStart::Next::read) {
    control_reader_ = std::jthread([this](const std::stop_token& stop) {
      auto controls = verification::read_controls_repeatedly(
          stop, names_, [this](const fabric::Call& call) { return client_->evaluate(call); });
      if (!stop.stop_requested()) put_(ControlsRead{std::move(controls)});
    });
  }
  return *next == verification::ControlStart::Next::take;
}

Result<std::vector<fabric::Block>> Channel::on_controls(const ControlsRead& read) {
  if (!read.controls) return Error{label_ + read.controls.error().message};
  std::vector<fabric::Block> held = control_start_.on_read();
  if (auto status = set_controls(*read.controls); !status) return status.error();
  return held;
}

std::function<void(fabric::Outcome)> Channel::on_end(const Submission& submission) const {
  return [this, id = submission.id, function = submission.call.function](fabric::Outcome outcome) {
    put_(Ended{id, function, std::move(outcome)});
  };
}

void Channel::submit(Submission submission) {
  auto ended = on_end(submission);
  (submission.urgent ? urgent_ : client_)->submit(std::move(submission.call), std::move(ended));
}

}  // namespace ledgerline::ground
