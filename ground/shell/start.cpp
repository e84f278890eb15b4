// Ground's beginning: topics, the service and the channels of the ledger.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <utility>

#include "common/base/log.hpp"
#include "common/fabric/client/repeated.hpp"
#include "common/rt/retry/keep_trying.hpp"
#include "ground/shell/ground.hpp"

namespace ledgerline::ground {
namespace {

// Once one channel is reached its drones must not wait long for the others'. A network that has just started needs a
// second or two; one that is away is away for longer.
constexpr TimeNs others_wait_ns = 2 * ns_per_s;

// As an operator's own call (OperatorService): what loses to another one is sent again.
constexpr fabric::RepeatLimits clear_limits{.attempts = 10, .conflicts_only = true};

}  // namespace

std::vector<std::unique_ptr<Channel>> Ground::open_channels(std::vector<Channel::Parts> parts) {
  std::vector<std::unique_ptr<Channel>> channels;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    std::string label = parts.size() > 1 ? fmt::format("channel {}: ", parts[i].flight.where.channel) : "";
    channels.push_back(
        std::make_unique<Channel>(std::move(parts[i]), std::move(label), [this, i](Channel::Update news) {
          const bool is_block = std::holds_alternative<fabric::Block>(news);
          OfChannel event{i, std::move(news)};
          is_block ? mailbox_.put_in_turn(std::move(event)) : mailbox_.put(std::move(event));
        }));
  }
  return channels;
}

Status Ground::start(const std::atomic<bool>& quit) {
  if (auto status = recorder_.open(output_.trace); !status) return status;
  if (auto status = open_topics(); !status) return status;
  start_certificates();
  for (const auto& channel : channels_) channel->open_stream();
  if (auto status = wait_for_block_streams(quit); !status) return status;
  for (const auto& channel : channels_) {
    if (const Status open = channel->connection(); !open) {  // behind its first block they are read anyway
      spdlog::error("{}not reached: {}. Its drones are not flown until it is", channel->label(), open.error().what);
    } else if (auto status = channel->read_controls(); !status) {
      if (channels_.size() == 1) return status;
      spdlog::error("{}: its drones are not flown until its records are read", status.error().what);
    }
  }
  if (missions_) {
    if (auto status = missions_->restore(); !status) return status;
  }
  return read_pilot_topics();
}

Status Ground::open_topics() {
  for (const DroneTopic& topic : drone_topics) {
    writers_.emplace_back();
    for (const FlightDrone& drone : view_.drones()) {
      if (topic.of_all && !writers_.back().empty()) continue;
      auto writer = dds::RawWriter::create(participant_, topic_of(topic, drone.name), std::string(topic.type),
                                           {.transient_local = topic.latched});
      if (!writer) return writer.error();
      writers_.back().push_back(std::move(writer).value());
    }
  }
  return done;
}

Status Ground::read_pilot_topics() {
  if (!pilot_.topics)
    spdlog::info("pilots' ROS 2 topics are not read: [pilot] topics = true reads them");
  else if (!pilot_.emergency)
    spdlog::info("/<drone>/emergency is not read without DDS Security: [pilot] emergency = true reads it");
  auto pilots = PilotReaders::create(
      participant_, names_, pilot_, [this](std::size_t drone, const PilotTopic& topic, std::string_view cdr) {
        post_command(drone, std::nullopt, [&](PilotCommand& command) { topic.take(cdr, monotonic_ns(), command); });
      });
  if (!pilots) return pilots.error();
  pilots_.emplace(std::move(pilots).value());
  return done;
}

Status Ground::wait_for_block_streams(const std::atomic<bool>& quit) {
  std::optional<TimeNs> first_ns;
  const auto are_open = [&]() -> Status {
    Status all = done;
    for (const auto& channel : channels_) {
      const Status open = channel->connection();
      if (open && !first_ns) first_ns = monotonic_ns();
      if (!open && all) all = Error{channel->label() + open.error().what};
    }
    return first_ns && monotonic_ns() - *first_ns > others_wait_ns ? Status(done) : all;
  };
  return keep_trying(
      "the ledger's blocks can be read", {}, [&] { return quit.load(); }, are_open);
}

Status Ground::open_service(const std::string& folder, const std::vector<fabric::ClientConfig>& ledgers) {
  auto operators = OperatorService::create(
      {.folder = folder,
       .ledgers = ledgers,
       .drones = names_,
       .channel_of = [this](std::size_t drone) { return view_.place(drone).channel; },
       .clear_ground_stop =
           [this](std::size_t channel, const fabric::Call& call) {
             return fabric::submit_repeatedly(channels_[channel]->urgent(), call, clear_limits, nullptr);
           },
       .tell = std::bind_front(&Ground::say, this),
       .on_session =
           [this](std::size_t who, bool in) {
             mailbox_.put(SessionChange{who, in});
           }});
  if (!operators) return Error{"[service] operators: " + operators.error().what};
  service_ = std::move(*operators);
  return done;
}

void Ground::dismiss(TimeNs now_ns) {
  std::vector<std::size_t> dismissed;
  for (const auto& roles : roles_) {
    const auto& of_channel = roles->step(now_ns);
    dismissed.insert(dismissed.end(), of_channel.begin(), of_channel.end());
  }
  if (dismissed != dismissed_) {
    server_->dismiss(dismissed);
    for (const std::size_t who : dismissed) {
      if (std::find(dismissed_.begin(), dismissed_.end(), who) != dismissed_.end()) continue;
      const std::string& name = service_->operators()[who].name;
      say(Level::warning, "",
          fmt::format("{} is no operator any more: signed out, and what {} holds lands", name, name));
    }
    dismissed_ = std::move(dismissed);
  }
  // Each time: what is flown now is still theirs.
  for (const std::size_t who : dismissed_) missions_->disown(service_->operators()[who].identity);
}

void Ground::open_missions(service::MissionSettings settings) {
  settings.check.flight = view_.config().controller;
  missions_ = std::make_unique<MissionService>(MissionService::Parts{
      .settings = std::move(settings),
      .core = view_,
      .client = channels_.front()->urgent(),
      .sign = [this](std::size_t who, const service::OperatorCall& call) { return service_->submit(who, call); },
      .signed_in = [this](std::size_t who) { return !leaving_.has(who); },
      .post_command = [this](const PilotCommand& one) { post_command(one); },
      .tell =
          [this](Level level, const std::string& drone, const std::string& words) {
            spdlog::log(level == Level::info ? spdlog::level::info : spdlog::level::warn, "{}{}{}", drone,
                        drone.empty() ? "" : ": ", words);
            unshown_.push_back(board_.tell(monotonic_ns(), level, drone, words));
          },
      .publish = [this](std::string list) { server_->publish_missions(std::move(list)); },
      .wake = [this] { mailbox_.wake(); }});
}

Status Ground::serve(const service::ServiceSettings& settings, service::MissionSettings missions,
                     const std::vector<fabric::ClientConfig>& ledgers) {
  const FlightConfig& flight = view_.config();
  const service::Greeting greeting{.manual = flight.manual,
                                   .speed_mps = flight.controller.speed_mps,
                                   .cmd_timeout_ns = flight.cmd_timeout_ns,
                                   .fence = missions.check.fence};
  open_missions(std::move(missions));
  if (!settings.operators.empty()) {
    if (Status opened = open_service(settings.operators, ledgers); !opened) return opened;
    for (const auto& channel : channels_) {
      roles_.push_back(std::make_unique<RoleWatch>(RoleWatch::Parts{
          .operators = service_->operators(),
          .evaluate = [&client = channel->urgent()](const fabric::Call& call) { return client.evaluate(call); },
          .wake = [this] { mailbox_.wake(); }}));
    }
  }
  self_ = ledgers.front().identity.in_use;
  session_idle_ns_ = settings.session_idle_ns;
  service::Server::Behind behind{.take = [this](const PilotCommand& one) { return take(one); },
                                 .keys = service_.get(),
                                 .ask_missions =
                                     [this](service::MissionAsk asked, std::function<void(service::ApiAnswer)> answer) {
                                       ask(std::move(asked), std::move(answer));
                                     },
                                 .tell = [this](Level level, std::string words) { say(level, "", std::move(words)); }};
  if (!settings.faults.empty()) {
    faults_ = std::make_unique<service::FaultService>(settings.faults, std::bind_front(&Ground::say, this));
    behind.ask_faults = std::bind_front(&service::FaultService::ask, faults_.get());
  }
  auto server = service::Server::start(settings, names_, greeting, std::move(behind));
  if (!server) return server.error();
  server_ = std::move(server).value();
  if (faults_) faults_->start([this](service::FaultList list) { server_->publish_faults(std::move(list)); });
  show(monotonic_ns());
  return done;
}

}  // namespace ledgerline::ground
