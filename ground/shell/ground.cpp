#include "ground/shell/ground.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>

#include "common/base/log.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {
namespace {

constexpr TimeNs tick_ns = 20 * ns_per_ms;  // for time-outs and signals; blocks and outcomes wake at once
constexpr TimeNs start_limit_ns = 15 * ns_per_s;
constexpr TimeNs landing_limit_ns = 15 * ns_per_s;
constexpr TimeNs warning_gap_ns = ns_per_s;

}  // namespace

Ground::Ground(FlightConfig flight, OutputSettings output, dds::ParticipantPtr participant,
               std::unique_ptr<fabric::Client> client, std::unique_ptr<fabric::Client> urgent)
    : output_(std::move(output)),
      core_(std::move(flight)),
      participant_(std::move(participant)),
      client_(std::move(client)),
      urgent_(std::move(urgent)) {}

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
  wake_.wait_for(lock, std::chrono::nanoseconds(timeout_ns), [&] { return !events_.empty() || !wishes_.empty(); });
  if (events_.empty()) return std::nullopt;
  Event event = std::move(events_.front());
  events_.pop_front();
  room_.notify_one();
  return event;
}

std::vector<PilotWish> Ground::take_wishes() {
  const std::lock_guard lock(mutex_);
  return std::exchange(wishes_, {});
}

Status Ground::start(const std::atomic<bool>& quit) {
  if (!output_.trace.empty()) {
    auto trace = TraceWriter::create(output_.trace);
    if (!trace) return trace.error();
    trace_ = std::move(trace).value();
  }
  if (auto status = open_topics(); !status) return status;
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
  handlers.on_unbelievable = [](const std::string& what) { spdlog::warn("{}", what); };
  blocks_ = client_->blocks(std::nullopt, std::move(handlers));
  if (auto status = read_controls(quit); !status) return status;
  return hear_pilots();
}

Status Ground::open_topics() {
  for (const DroneTopic& topic : drone_topics) {
    writers_.emplace_back();
    for (const FlightDrone& drone : core_.drones()) {
      if (topic.of_all && !writers_.back().empty()) continue;
      auto writer = dds::RawWriter::create(participant_, topic_of(topic, drone.name), std::string(topic.type),
                                           {.transient_local = topic.latched});
      if (!writer) return writer.error();
      writers_.back().push_back(std::move(writer).value());
    }
  }
  return done;
}

Status Ground::hear_pilots() {
  for (std::size_t i = 0; i < core_.drones().size(); ++i) {
    for (const PilotTopic& topic : pilot_topics) {
      auto reader = dds::RawReader::create(participant_, topic_of(topic, core_.drones()[i].name),
                                           std::string(topic.type), {.reliable = topic.reliable},
                                           [this, i, &topic](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
                                             hear(i, topic, dds::text_of(cdr));
                                           });
      if (!reader) return reader.error();
      readers_.push_back(std::move(reader).value());
    }
  }
  return done;
}

void Ground::hear(std::size_t drone, const PilotTopic& topic, std::string_view cdr) {
  {
    const std::lock_guard lock(mutex_);
    auto wish = std::find_if(wishes_.begin(), wishes_.end(), [&](const PilotWish& w) { return w.drone == drone; });
    if (wish == wishes_.end()) wish = wishes_.insert(wish, {.drone = drone});
    topic.take(cdr, monotonic_ns(), *wish);
  }
  wake_.notify_one();
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
    const auto answer = client_->evaluate({contract::get, {query.SerializeAsString()}});
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
    const std::vector<PilotWish> wishes = take_wishes();
    inputs.wishes = wishes;
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
    (submission.urgent ? urgent_ : client_)->submit(std::move(submission.call), [this, id](fabric::Outcome outcome) {
      hand_over(Ended{id, std::move(outcome)});
    });
  }
  if (trace_) {
    for (const TraceRecord& record : out.traces) trace_->add(record);
  }
  for (const std::string& note : out.notes) spdlog::warn("{}", note);
  for (const DroneNews& news : out.news) publish(news);
}

void Ground::publish(const DroneNews& news) {
  const std::string& drone = core_.drones()[news.drone].name;
  for (std::size_t i = 0; i < drone_topics.size(); ++i) {
    const DroneTopic& topic = drone_topics[i];
    const auto message = topic.make(news, drone);
    Status published = message ? done : Status(message.error());
    if (message && !message->empty()) published = writers_[i][topic.of_all ? 0 : news.drone].publish(*message);
    if (published) continue;
    ++counters_.news_unpublished;
    if (monotonic_ns() < next_warning_ns_) continue;
    next_warning_ns_ = monotonic_ns() + warning_gap_ns;
    spdlog::warn("{}: {}", topic_of(topic, drone), published.error().what);
  }
}

void Ground::count_losses() {
  counters_.pilots.assign(core_.drones().size(), {});
  for (std::size_t i = 0; i < readers_.size(); ++i) {
    ShellCounters::Pilot& pilot = counters_.pilots[i / pilot_topics.size()];
    const dds::Refused refused = readers_[i].refused();
    pilot.dds_lost += readers_[i].lost();
    pilot.dds_refused += refused.total();
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
  count_losses();
  std::ofstream file(output_.summary);
  file << summary(core_, counters_) << "\n";
  file.close();
  if (!file) return Error{"cannot write " + output_.summary};
  return done;
}

}  // namespace ledgerline::ground
