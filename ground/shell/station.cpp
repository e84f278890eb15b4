#include "ground/shell/station.hpp"

#include <algorithm>
#include <utility>

#include "common/base/log.hpp"
#include "common/msg/contract.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::ground {
namespace {

constexpr TimeNs show_gap_ns = ns_per_s / 30;      // while somebody looks at the page
constexpr TimeNs unwatched_gap_ns = ns_per_s / 2;  // while nobody does
constexpr TimeNs event_gap_ns = 2 * ns_per_ms;     // of what the next order may be refused by

}  // namespace

Status Station::open(const service::ServiceSettings& settings, const service::Greeting& greeting,
                     service::Server::Handlers handlers, service::FaultService::Report report_fault) {
  if (!settings.faults.empty()) {
    faults_ = std::make_unique<service::FaultService>(settings.faults, std::move(report_fault));
    handlers.request_fault = std::bind_front(&service::FaultService::request, faults_.get());
  }
  auto server = service::Server::start(settings, names_, greeting, std::move(handlers));
  if (!server) return server.error();
  server_ = std::move(server).value();
  if (faults_) faults_->start([this](service::FaultList list) { server_->publish_faults(std::move(list)); });
  show(monotonic_ns());
  return done;
}

void Station::close() {
  if (faults_) faults_->close();
}

void Station::add_event(Level level, const std::string& drone, std::string words) {
  unshown_.push_back(board_.make_event(monotonic_ns(), level, drone, std::move(words)));
}

void Station::show_changes_of(const fabric::Block& block) {
  const auto changes = [](const fabric::Transaction& one) {
    return one.function != contract::set && one.function != contract::command;
  };
  if (std::ranges::any_of(block.transactions, changes))
    next_show_ns_ = std::min(next_show_ns_, shown_ns_ + event_gap_ns);
}

void Station::add_block(const fabric::Block& block) {
  unshown_blocks_.push_back(
      service::summary_of(block, monotonic_ns(), self_->now()->serialized, view_.config().where.contract));
  if (server_->watched() || unshown_blocks_.size() >= service::max_reported_blocks)
    server_->publish_blocks(std::exchange(unshown_blocks_, {}));
}

void Station::update(const std::vector<std::string>& notes) {
  for (service::Notice& request : requests_.pop_due(monotonic_ns())) {
    spdlog::info("{}{}{}", request.drone, request.drone.empty() ? "" : ": ", request.text);
    add_event(Level::info, request.drone, std::move(request.text));
  }
  for (service::Event& event : board_.update(monotonic_ns(), view_, notes)) {
    if (event.level == Level::alarm) spdlog::error("{}: {}", event.drone, event.text);  // outlives the station
    unshown_.push_back(std::move(event));
  }
  for (service::Event& event : board_.refusals(monotonic_ns(), refusals_)) unshown_.push_back(std::move(event));
  // What has changed decides what the next request is answered, whether somebody watches or not.
  if (!unshown_.empty()) next_show_ns_ = std::min(next_show_ns_, shown_ns_ + event_gap_ns);
}

void Station::show(TimeNs now_ns) {
  if (now_ns < next_show_ns_) return;
  shown_ns_ = now_ns;
  next_show_ns_ = now_ns + (server_->watched() ? show_gap_ns : unwatched_gap_ns);
  service::BoardState board{.drones = service::Board::drones(now_ns, view_)};
  board.paths = board_.changed_paths(view_);
  board.state = service::Board::state_message(now_ns, view_, board.drones);
  board.aloft = service::aloft_of(view_);
  board.stopped = service::stopped_of(view_);
  board.unplaced = service::unplaced_of(view_);
  board.stopped_by_ground = service::stopped_by_ground(view_);
  board.leases = service::leases_of(view_);
  for (std::size_t drone = 0; drone < names_.size(); ++drone) board.phases.push_back(view_.status(drone).phase);
  board.events = std::exchange(unshown_, {});
  server_->publish(std::move(board));
}

void Station::end() {
  next_show_ns_ = 0;
  show(monotonic_ns());
  server_->end();
}

}  // namespace ledgerline::ground
