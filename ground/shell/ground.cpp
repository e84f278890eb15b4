#include "ground/shell/ground.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <fstream>

#include "common/msg/form.hpp"
#include "common/rt/log.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {
namespace {

constexpr TimeNs tick_ns = 20 * ns_per_ms;  // for time-outs and signals; blocks and outcomes wake at once
constexpr TimeNs start_limit_ns = 15 * ns_per_s;
constexpr TimeNs landing_limit_ns = 15 * ns_per_s;

}  // namespace

Ground::Ground(FlightConfig flight, OutputSettings output, std::unique_ptr<fabric::Client> client)
    : output_(std::move(output)), core_(std::move(flight)), client_(std::move(client)) {}

Ground::~Ground() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  room_.notify_all();
}

void Ground::hand_over(Event event) {
  {
    std::unique_lock lock(mutex_);
    // Blocks wait in the stream; outcomes are as many as there are calls in flight.
    if (std::holds_alternative<fabric::Block>(event)) {
      room_.wait(lock, [&] { return events_.size() < max_events || closing_; });
    }
    events_.push_back(std::move(event));
  }
  wake_.notify_one();
}

bool Ground::has_event() {
  const std::lock_guard lock(mutex_);
  return !events_.empty();
}

std::optional<Ground::Event> Ground::next_event(TimeNs timeout_ns) {
  std::unique_lock lock(mutex_);
  wake_.wait_for(lock, std::chrono::nanoseconds(timeout_ns), [&] { return !events_.empty(); });
  if (events_.empty()) return std::nullopt;
  Event event = std::move(events_.front());
  events_.pop_front();
  room_.notify_one();
  return event;
}

Status Ground::start(const std::atomic<bool>& quit) {
  if (!output_.trace.empty()) {
    auto trace = TraceWriter::create(output_.trace);
    if (!trace) return trace.error();
    trace_ = std::move(trace).value();
  }
  auto participant = dds::Participant::create();
  if (!participant) return participant.error();
  participant_ = std::move(participant).value();
  for (const FlightDrone& drone : core_.drones()) {
    auto publisher = dds::OdometryPublisher::create(participant_, "/" + drone.name + "/odom");
    if (!publisher) return publisher.error();
    odometry_.push_back(std::move(publisher).value());
  }
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [this](const fabric::Block& block, std::string_view) { hand_over(block); };
  handlers.on_connection = [this](bool connected, const std::string& why) {
    if (connected) {
      spdlog::info("block stream connected");
    } else {
      spdlog::warn("block stream: {}", why);
    }
    {
      const std::lock_guard lock(mutex_);
      connected_ = connected;
      connection_problem_ = why;
    }
    wake_.notify_one();
  };
  blocks_ = client_->blocks(std::nullopt, std::move(handlers));
  return read_controls(quit);
}

// Behind the start of the block stream, so that no change of a record can be missed between the two.
Status Ground::read_controls(const std::atomic<bool>& quit) {
  const TimeNs until_ns = monotonic_ns() + start_limit_ns;
  {
    std::unique_lock lock(mutex_);
    while (!connected_) {
      if (quit) return Error{"asked to end before the ledger was reached"};
      if (monotonic_ns() > until_ns) {
        return Error{fmt::format("the ledger's blocks cannot be read: {}",
                                 connection_problem_.empty() ? "no answer" : connection_problem_)};
      }
      wake_.wait_for(lock, std::chrono::nanoseconds(tick_ns));
    }
  }
  for (const FlightDrone& drone : core_.drones()) {
    QueryCall query;
    query.set_id("control/" + drone.name);
    const auto answer = client_->evaluate({"get", {query.SerializeAsString()}});
    if (!answer)
      return Error{fmt::format("{}: its control record cannot be read: {}", drone.name, answer.error().what)};
    Assets assets;
    if (auto status = parse_message(*answer, assets); !status) return status;
    if (assets.assets_size() != 1) return Error{fmt::format("{} is not enrolled", drone.name)};
    if (auto status = core_.set_control(assets.assets(0).msg_data()); !status) return status;
  }
  return done;
}

Result<bool> Ground::run(const std::atomic<bool>& quit) {
  TimeNs leave_ns = 0;
  while (!core_.done()) {
    const auto event = next_event(tick_ns);
    FlightInputs inputs;
    if (event) {
      if (const auto* block = std::get_if<fabric::Block>(&*event)) {
        inputs.block = block;
      } else {
        inputs.outcome = &std::get<Ended>(*event).outcome;
        inputs.outcome_id = std::get<Ended>(*event).id;
        if (inputs.outcome->kind != fabric::Outcome::Kind::committed) {
          spdlog::warn("a command did not get through (block {}, code {}): {}", inputs.outcome->block,
                       inputs.outcome->code, inputs.outcome->message);
        }
      }
    }
    inputs.more = has_event();
    const TimeNs now_ns = monotonic_ns();
    if (quit && leave_ns == 0) {
      spdlog::info("asked to end: landing all drones");
      inputs.land = "asked to land";
      leave_ns = now_ns + landing_limit_ns;
    }
    step(inputs);
    if (leave_ns != 0 && now_ns > leave_ns) {
      spdlog::error("not all drones were seen to land within {:.0f} s", to_seconds(landing_limit_ns));
      break;
    }
    if (output_.status_period_ns > 0 && now_ns >= next_status_ns_) write_status(now_ns);
  }
  if (output_.status_period_ns > 0) write_status(monotonic_ns());
  if (auto status = write_summary(); !status) return status.error();
  return core_.ok();
}

void Ground::step(FlightInputs inputs) {
  inputs.realtime_s = realtime_ns() / ns_per_s;
  FlightOutputs out = core_.step(monotonic_ns(), inputs);
  for (Submission& submission : out.submissions) {
    const std::uint64_t id = submission.id;
    client_->submit(std::move(submission.call), [this, id](fabric::Outcome outcome) {
      hand_over(Ended{id, std::move(outcome)});
    });
  }
  if (trace_) {
    for (const TraceRecord& record : out.traces) trace_->add(record);
  }
  for (const OdometryCdr& one : out.odometry) {
    const auto odometry = odometry_from_cdr(one.cdr);
    if (!odometry) {
      spdlog::warn("{}: its odometry is no nav_msgs/msg/Odometry: {}", core_.drones()[one.drone].name,
                   odometry.error().what);
    } else if (auto status = odometry_[one.drone].publish(*odometry); !status) {
      spdlog::warn("{}", status.error().what);
    }
  }
}

void Ground::write_status(TimeNs now_ns) {
  next_status_ns_ = now_ns + output_.status_period_ns;
  fmt::print("{}\n", status_line(core_));
  std::fflush(stdout);
}

Status Ground::write_summary() {
  if (trace_) {
    if (auto status = trace_->flush(); !status) return status;
    if (trace_->dropped() > 0) spdlog::warn("{}: {} records did not fit", output_.trace, trace_->dropped());
  }
  if (output_.summary.empty()) return done;
  std::ofstream file(output_.summary);
  file << summary(core_) << "\n";
  file.close();
  if (!file) return Error{"cannot write " + output_.summary};
  return done;
}

}  // namespace ledgerline::ground
