#include "ground/shell/ground.hpp"

#include <fmt/format.h>

#include <functional>
#include <optional>
#include <utility>

#include "common/base/log.hpp"
#include "common/fabric/client/submit_repeatedly.hpp"
#include "common/program/program.hpp"
#include "common/rt/retry.hpp"
#include "common/rt/scheduling.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {
namespace {

constexpr TimeNs unheard_gap_ns = 10 * ns_per_s;  // a peer may be away for long
constexpr TimeNs tick_ns = 20 * ns_per_ms;        // for time-outs and signals; blocks and outcomes wake at once
constexpr TimeNs landing_limit_ns = 15 * ns_per_s;
// Once one channel is reached its drones must not wait long for the others'. A network that has just started needs a
// second or two; one that is away is away for longer.
constexpr TimeNs others_wait_ns = 2 * ns_per_s;

// As an operator's own call (OperatorService): what loses to another one is sent again.
constexpr fabric::RepeatLimits clear_limits{.attempts = 10, .conflicts_only = true};

std::vector<std::string> names_of(const FlightView& view) {
  std::vector<std::string> names;
  for (const FlightDrone& drone : view.drones()) names.push_back(drone.name);
  return names;
}

Level level_of(fabric::CertificateWatch::Weight weight) {
  using Weight = fabric::CertificateWatch::Weight;
  return weight == Weight::info ? Level::info : weight == Weight::warning ? Level::warning : Level::alarm;
}

FlightView view_of(const std::vector<std::unique_ptr<Channel>>& channels, const std::vector<std::size_t>& channel_of) {
  std::vector<const FlightCore*> cores;
  for (const auto& channel : channels) cores.push_back(&channel->core());
  return {std::move(cores), channel_of};
}

}  // namespace

Ground::Ground(std::vector<Channel::Parts> channels, const std::vector<std::size_t>& channel_of, OutputSettings output,
               const PilotSettings& pilot, dds::ParticipantPtr participant,
               std::unique_ptr<fabric::CertificateWatch> watch)
    : output_(std::move(output)),
      pilot_(pilot),
      channels_(open_channels(std::move(channels))),
      view_(view_of(channels_, channel_of)),
      names_(names_of(view_)),
      topics_(std::move(participant), names_),
      lost_(channels_.size()),
      watch_(std::move(watch)) {}

Ground::~Ground() {
  inbox_.close();
  if (missions_) missions_->close();
  if (operators_) operators_->close();
  if (station_) station_->close();
  for (const auto& channel : channels_) channel->close();
}

std::vector<std::unique_ptr<Channel>> Ground::open_channels(std::vector<Channel::Parts> parts) {
  std::vector<std::unique_ptr<Channel>> channels;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    std::string label = parts.size() > 1 ? fmt::format("channel {}: ", parts[i].flight.where.channel) : "";
    channels.push_back(
        std::make_unique<Channel>(std::move(parts[i]), std::move(label), [this, i](Channel::Update update) {
          const bool is_block = std::holds_alternative<fabric::Block>(update);
          Inbox::ChannelUpdate event{i, std::move(update)};
          is_block ? inbox_.put_in_turn(std::move(event)) : inbox_.put(std::move(event));
        }));
  }
  return channels;
}

Status Ground::start(const std::atomic<bool>& quit) {
  if (auto status = recorder_.open(output_.trace); !status) return status;
  if (auto status = topics_.open_writers(); !status) return status;
  watch_->start([this](fabric::CertificateWatch::Weight weight, const std::string& words) {
    fabric::CertificateWatch::log(weight, words);
    if (station_) post_event(level_of(weight), "", words);
  });
  for (const auto& channel : channels_) channel->open_stream();
  if (auto status = wait_for_block_streams(quit); !status) return status;
  for (const auto& channel : channels_) {
    if (const Status open = channel->connection(); !open) {  // behind its first block they are read anyway
      spdlog::error("{}not reached: {}. Its drones are not flown until it is", channel->label(), open.error().message);
    } else if (auto status = channel->read_controls(); !status) {
      if (channels_.size() == 1) return status;
      spdlog::error("{}: its drones are not flown until its records are read", status.error().message);
    }
  }
  if (missions_) {
    if (auto status = missions_->restore(); !status) return status;
  }
  return topics_.read_pilots(
      pilot_,
      [this](std::size_t drone, const PilotTopic& topic, std::string_view cdr) {
        inbox_.post_command(drone, std::nullopt,
                            [&](PilotCommand& command) { topic.apply(cdr, monotonic_ns(), command); });
      },
      [this](std::size_t drone, const std::string& why) {
        spdlog::warn("{}", why);
        post_event(Level::warning, names_[drone], why);
      });
}

Status Ground::wait_for_block_streams(const std::atomic<bool>& quit) {
  std::optional<TimeNs> first_ns;
  const auto are_open = [&]() -> Status {
    Status all = done;
    for (const auto& channel : channels_) {
      const Status open = channel->connection();
      if (open && !first_ns) first_ns = monotonic_ns();
      if (!open && all) all = Error{channel->label() + open.error().message};
    }
    return first_ns && monotonic_ns() - *first_ns > others_wait_ns ? Status(done) : all;
  };
  return retry(
      "the ledger's blocks can be read", {}, [&] { return quit.load(); }, are_open);
}

Status Ground::open_operators(const service::ServiceSettings& settings,
                              const std::vector<fabric::ClientConfig>& ledgers) {
  auto keys = OperatorService::create({.folder = settings.operators,
                                       .ledgers = ledgers,
                                       .drones = names_,
                                       .channel_of = [this](std::size_t drone) { return view_.slot(drone).channel; },
                                       .clear_ground_stop =
                                           [this](std::size_t channel, const fabric::Call& call) {
                                             return fabric::submit_repeatedly(channels_[channel]->urgent(), call,
                                                                              clear_limits, nullptr);
                                           },
                                       .report = std::bind_front(&Ground::post_event, this),
                                       .on_session =
                                           [this](std::size_t who, bool in) {
                                             inbox_.put(Inbox::SessionChange{who, in});
                                           }});
  if (!keys) return Error{"[service] operators: " + keys.error().message};
  std::vector<verification::Evaluate> evaluate;
  for (const auto& channel : channels_)
    evaluate.push_back([&client = channel->urgent()](const fabric::Call& call) { return client.evaluate(call); });
  operators_ = std::make_unique<OperatorSessions>(
      OperatorSessions::Parts{.view = view_,
                              .service = std::move(*keys),
                              .ledgers = std::move(evaluate),
                              .wake = [this] { inbox_.wake(); },
                              .idle_ns = settings.session_idle_ns,
                              .post_command = [this](const PilotCommand& one) { inbox_.post_command(one); },
                              .warn = [this](const std::string& words) { post_event(Level::warning, "", words); },
                              .dismiss = [this](const std::vector<std::size_t>& who) { station_->dismiss(who); },
                              .disown = [this](const crypto::IdentityName& who) { missions_->disown(who); }});
  return done;
}

void Ground::open_missions(service::MissionSettings settings) {
  settings.check.flight = view_.config().controller;
  missions_ = std::make_unique<MissionService>(MissionService::Parts{
      .settings = std::move(settings),
      .flights = view_,
      .client = channels_.front()->urgent(),
      .sign = [this](std::size_t who,
                     const service::OperatorCall& call) { return operators_->keys().submit(who, call); },
      .signed_in = [this](std::size_t who) { return !operators_ || !operators_->has_left(who); },
      .post_command = [this](const PilotCommand& one) { inbox_.post_command(one); },
      .report =
          [this](Level level, const std::string& drone, const std::string& words) {
            spdlog::log(level == Level::info ? spdlog::level::info : spdlog::level::warn, "{}{}{}", drone,
                        drone.empty() ? "" : ": ", words);
            station_->add_event(level, drone, words);
          },
      .report_request = [this](const std::string& words) { station_->add_request("", words); },
      .publish = [this](std::string list) { station_->publish_missions(std::move(list)); },
      .wake = [this] { inbox_.wake(); }});
}

Status Ground::serve(const service::ServiceSettings& settings, service::MissionSettings missions,
                     const std::vector<fabric::ClientConfig>& ledgers) {
  const FlightConfig& flight = view_.config();
  const service::Greeting greeting{.manual = flight.manual,
                                   .speed_mps = flight.controller.speed_mps,
                                   .height_m = flight.controller.height_m,
                                   .cmd_timeout_ns = flight.cmd_timeout_ns,
                                   .fence = missions.check.fence};
  station_ = std::make_unique<Station>(view_, names_, ledgers.front().identity.in_use);
  open_missions(std::move(missions));
  if (!settings.operators.empty()) {
    if (Status opened = open_operators(settings, ledgers); !opened) return opened;
  }
  service::Server::Handlers handlers{
      .take = [this](const PilotCommand& one) { return command(one); },
      .keys = operators_ ? &operators_->keys() : nullptr,
      .request_mission =
          [this](service::MissionRequest asked, std::function<void(service::ApiAnswer)> answer) {
            request_mission(std::move(asked), std::move(answer));
          },
      .report = [this](Level level, std::string words) { post_event(level, "", std::move(words)); }};
  return station_->open(settings, greeting, std::move(handlers), std::bind_front(&Ground::post_event, this));
}

void Ground::post_event(Level level, const std::string& drone, std::string words) {
  inbox_.put(Inbox::Report{level, drone, std::move(words)});
}

// A stop may wait until the ledger is reached, and so may a landing; nobody wants another word then that he gave
// before.
Status Ground::command(const PilotCommand& one) {
  if (!flying_ && !brings_down(one)) return Error{"the ledger is not reached yet: nothing can fly"};
  inbox_.post_command(one);
  return done;
}

void Ground::request_mission(service::MissionRequest asked, std::function<void(service::ApiAnswer)> answer) {
  if (!flying_) return answer(service::refusal(503, "the ledger is not reached yet"));
  missions_->request(std::move(asked), std::move(answer));
}

Status Ground::dispatch(std::size_t index, const Channel::Update& update, FlightInputs& inputs) {
  Channel& channel = *channels_[index];
  if (const auto* block = std::get_if<fabric::Block>(&update)) {
    const auto now = channel.on_block(*block);
    if (!now) return now.error();
    if (!*now) return done;
    inputs.block = block;
    ends_.add(*block);
    if (operators_) operators_->on_block(index, *block);
    if (station_) station_->show_changes_of(*block);
    if (index > 0) return done;  // missions are approved on the channel of [ledger], whose blocks the page shows
    if (station_) station_->add_block(*block);
    if (missions_) missions_->on_block(*block);
  } else if (const auto* ended = std::get_if<Channel::Ended>(&update)) {
    inputs.outcome = &ended->outcome;
    inputs.outcome_id = ended->id;
    if (!ended->outcome.unheard.empty() && monotonic_ns() >= next_unheard_log_ns_) {
      next_unheard_log_ns_ = monotonic_ns() + unheard_gap_ns;
      spdlog::warn("{}a call was endorsed by less than all peers that were asked: {}", channel.label(),
                   ended->outcome.unheard);
    }
    if (station_) station_->add_outcome(ended->function, ended->outcome);
    if (ended->outcome.kind != fabric::Outcome::Kind::committed) {
      spdlog::warn("{}a command did not get through (block {}, code {}): {}", channel.label(), ended->outcome.block,
                   ended->outcome.code, ended->outcome.message);
    }
  } else if (const auto* read = std::get_if<Channel::ControlsRead>(&update)) {
    auto held = channel.on_controls(*read);
    if (!held) return held.error();
    // The blocks that waited come next, before any that came behind them.
    std::vector<Inbox::Event> next;
    for (fabric::Block& each : *held) next.push_back(Inbox::ChannelUpdate{index, std::move(each)});
    inbox_.put_first(std::move(next));
  }
  return done;
}

Status Ground::dispatch(const Inbox::Event& event, std::vector<FlightInputs>& inputs) {
  if (const auto* of = std::get_if<Inbox::ChannelUpdate>(&event)) {
    if (lost_[of->channel]) return done;
    const Status opened = dispatch(of->channel, of->update, inputs[of->channel]);
    if (opened || channels_.size() == 1) return opened;
    fail_channel(of->channel, opened.error());
    return done;
  }
  if (const auto* report = std::get_if<Inbox::Report>(&event)) {
    if (station_) station_->add_event(report->level, report->drone, report->words);
  } else if (const auto* change = std::get_if<Inbox::SessionChange>(&event)) {
    operators_->change(change->who, change->in, monotonic_ns());
  }
  return done;
}

// The other channels' drones must not lose their commander with it.
void Ground::fail_channel(std::size_t channel, const Error& why) {
  lost_[channel] = true;
  std::string words = why.message + ". Its drones are asked to land, and are not flown any more";
  spdlog::error("{}", words);
  post_event(Level::alarm, "", std::move(words));
}

std::vector<std::vector<PilotCommand>> Ground::split(const std::vector<PilotCommand>& commands) const {
  std::vector<std::vector<PilotCommand>> of_each(channels_.size());
  for (const PilotCommand& command : commands) {
    const FlightView::DroneSlot slot = view_.slot(command.drone);
    of_each[slot.channel].push_back(command);
    of_each[slot.channel].back().drone = slot.drone;
  }
  return of_each;
}

// The ledger has ground's own commands, under the lease of the drone's holder: who asked for them is said here.
void Ground::report_requests(const std::vector<PilotCommand>& commands) {
  for (const PilotCommand& command : commands) {
    for (const std::string& words : command.requests) station_->add_request(names_[command.drone], words);
  }
}

Result<bool> Ground::run(const std::atomic<bool>& quit) {
  flying_ = true;
  (void)enter_scheduling(Scheduling::short_slices);  // it is well enough without
  if (operators_) operators_->await_all(monotonic_ns());
  TimeNs leave_ns = 0;
  while (!view_.done()) {
    const auto event = inbox_.next(tick_ns);
    std::vector<FlightInputs> inputs(channels_.size());
    if (event) {
      if (auto status = dispatch(*event, inputs); !status) return status.error();
    }
    const std::vector<PilotCommand> commanded = inbox_.pop_commands();
    report_requests(commanded);
    const std::vector<std::vector<PilotCommand>> commands = split(commanded);
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      inputs[i].commands = commands[i];
      inputs[i].more = inbox_.has_more_for(i);
      if (lost_[i]) inputs[i].land = "its channel is lost";
    }
    const TimeNs now_ns = monotonic_ns();
    if (quit && leave_ns == 0) {
      spdlog::info("asked to end: landing all drones");
      for (FlightInputs& each : inputs) each.land = "asked to land";
      leave_ns = now_ns + landing_limit_ns;
    }
    step(std::move(inputs));
    if (missions_) missions_->step(now_ns);
    if (leave_ns != 0 && now_ns > leave_ns) {
      spdlog::error("not all drones were seen to land within {:.0f} s", to_seconds(landing_limit_ns));
      break;
    }
    if (operators_) operators_->step(now_ns);
    report_certificate_ends(now_ns);
    if (station_) station_->show(monotonic_ns());
    if (output_.status_period_ns > 0 && now_ns >= next_status_ns_) write_status(now_ns);
  }
  if (output_.status_period_ns > 0) write_status(monotonic_ns());
  flying_ = false;  // from here on the page is answered that nothing flies
  if (station_) station_->end();
  if (auto status = write_summary(); !status) return status.error();
  const bool ok = view_.ok();
  if (const std::string why = view_.why(); !why.empty())
    spdlog::log(ok ? spdlog::level::info : spdlog::level::err, "{}", why);
  return ok;
}

void Ground::step(std::vector<FlightInputs> inputs) {
  std::vector<std::string> notes;
  const std::vector<std::string> unheard = topics_.unheard();
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    for (std::size_t k = 0; !unheard.empty() && k < view_.of_channel(i).drones().size(); ++k)
      inputs[i].unheard.push_back(unheard[view_.drone_at({i, k})]);
    inputs[i].realtime_s = realtime_ns() / ns_per_s;
    FlightOutputs out = channels_[i]->core().step(monotonic_ns(), inputs[i]);
    act(i, out);
    for (std::string& note : out.notes) notes.push_back(std::move(note));
  }
  for (const std::string& note : notes) spdlog::warn("{}", note);
  if (station_) return station_->update(notes);
  for (const service::Event& event : board_.update(monotonic_ns(), view_, {})) {
    if (event.level == Level::alarm) spdlog::error("{}: {}", event.drone, event.text);
  }
}

void Ground::act(std::size_t index, FlightOutputs& out) {
  Channel& channel = *channels_[index];
  for (Submission& submission : out.submissions) {
    // A stop whose stopper has signed out meanwhile is ground's own.
    if (submission.by && operators_->keys().stop(*submission.by, index, submission.call, channel.on_end(submission)))
      continue;
    channel.submit(std::move(submission));
  }
  recorder_.add(out.traces);
  for (auto* updates : {&out.updates, &out.diagnoses}) {
    for (DroneUpdate& update : *updates) {
      update.drone = view_.drone_at({index, update.drone});
      topics_.publish(update);
    }
  }
}

ShellCounters Ground::losses_of(std::size_t channel) const {
  ShellCounters counters;
  counters.pilots.assign(view_.of_channel(channel).drones().size(), {});
  for (std::size_t i = 0; i < names_.size(); ++i) {
    const FlightView::DroneSlot slot = view_.slot(i);
    if (slot.channel != channel) continue;
    counters.pilots[slot.drone] = topics_.losses(i);
    counters.news_unpublished += topics_.unpublished(i);
  }
  counters.confirmed_after_ms = channels_[channel]->confirmed_after_ms();
  return counters;
}

void Ground::report_certificate_ends(TimeNs now_ns) {
  if (now_ns < next_ends_ns_) return;
  next_ends_ns_ = now_ns + ns_per_s;
  for (const crypto::Renewal::Notice& word : ends_.pop_due(realtime_ns() / ns_per_s)) {
    spdlog::warn("{}", word.words);
    const bool alarm = word.weight == crypto::Renewal::Weight::alarm;
    if (station_) station_->add_event(alarm ? Level::alarm : Level::warning, "", word.words);
  }
}

void Ground::write_status(TimeNs now_ns) {
  next_status_ns_ = now_ns + output_.status_period_ns;
  print_status(status_line(view_, watch_->days_left()));
}

Status Ground::write_summary() {
  return recorder_.end(output_.summary, [this] {
    std::vector<std::string> of_each;
    for (std::size_t i = 0; i < channels_.size(); ++i) of_each.push_back(summary(channels_[i]->core(), losses_of(i)));
    return of_each.size() == 1 ? of_each.front() : summary_of_all(of_each);
  });
}

}  // namespace ledgerline::ground
