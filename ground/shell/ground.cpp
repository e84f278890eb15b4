#include "ground/shell/ground.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "common/base/log.hpp"
#include "common/program/program.hpp"
#include "common/rt/retry/keep_trying.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {
namespace {

constexpr TimeNs unheard_gap_ns = 10 * ns_per_s;  // a peer may be away for long
constexpr TimeNs tick_ns = 20 * ns_per_ms;        // for time-outs and signals; blocks and outcomes wake at once
constexpr TimeNs landing_limit_ns = 15 * ns_per_s;
constexpr TimeNs warning_gap_ns = ns_per_s;
constexpr TimeNs show_gap_ns = ns_per_s / 30;      // while somebody looks at the page
constexpr TimeNs unwatched_gap_ns = ns_per_s / 2;  // while nobody does

std::vector<std::string> names_of(const FlightView& view) {
  std::vector<std::string> names;
  for (const FlightDrone& drone : view.drones()) names.push_back(drone.name);
  return names;
}

FlightView view_of(const std::vector<std::unique_ptr<Channel>>& channels, const std::vector<std::size_t>& channel_of) {
  std::vector<const FlightCore*> cores;
  for (const auto& channel : channels) cores.push_back(&channel->core());
  return {std::move(cores), channel_of};
}

}  // namespace

Ground::Ground(std::vector<Channel::Parts> channels, const std::vector<std::size_t>& channel_of, OutputSettings output,
               const PilotSettings& pilot, dds::ParticipantPtr participant)
    : output_(std::move(output)),
      pilot_(pilot),
      channels_(open_channels(std::move(channels))),
      view_(view_of(channels_, channel_of)),
      names_(names_of(view_)),
      participant_(std::move(participant)),
      refusals_(names_),
      lost_(channels_.size()),
      news_unpublished_(channels_.size()) {}

Ground::~Ground() {
  mailbox_.close();
  for (const auto& roles : roles_) roles->close();
  if (missions_) missions_->close();
  if (service_) service_->close();
  if (faults_) faults_->close();
  for (const auto& channel : channels_) channel->close();
}

std::optional<Ground::Event> Ground::next_event(TimeNs timeout_ns) {
  if (events_.empty()) {
    mailbox_.wait(timeout_ns);
    events_ = mailbox_.take_all();
  }
  if (events_.empty()) return std::nullopt;
  Event event = std::move(events_.front());
  events_.pop_front();
  return event;
}

std::vector<PilotCommand> Ground::take_commands() {
  const std::lock_guard lock(commands_mutex_);
  return std::exchange(commands_, {});
}

void Ground::post_command(std::size_t drone, const std::optional<crypto::IdentityName>& by,
                          const std::function<void(PilotCommand&)>& change) {
  {
    const std::lock_guard lock(commands_mutex_);
    auto waiting = std::find_if(commands_.begin(), commands_.end(),
                                [&](const PilotCommand& w) { return w.drone == drone && w.by == by; });
    if (waiting == commands_.end()) waiting = commands_.insert(waiting, {.drone = drone, .by = by});
    change(*waiting);
  }
  mailbox_.wake();
}

void Ground::post_command(const PilotCommand& one) {
  post_command(one.drone, one.by, [&](PilotCommand& waiting) { service::merge(one, waiting); });
}

void Ground::say(Level level, const std::string& drone, std::string words) {
  mailbox_.put(Report{level, drone, std::move(words)});
}

void Ground::end_session(TimeNs now_ns) {
  for (const std::size_t who : leaving_.all()) {
    const crypto::IdentityName& identity = service_->operators()[who].identity;
    const service::Held held = service::held_by(view_, identity);
    const service::Leaving::Step step = leaving_.step(now_ns, who, held);
    for (const std::size_t drone : step.land) post_command({.drone = drone, .by = identity, .land = true});
    if (!step.give_back) continue;
    const bool is_posted = service_->end_session(who, held.drones);  // false: too much waits to be signed
    if (!is_posted && step.last) service_->forget(who);
    if (is_posted || step.last) leaving_.remove(who);
  }
}

// A stop may wait until the ledger is reached, and so may a landing; nobody wants another word then that he gave
// before.
Status Ground::take(const PilotCommand& one) {
  if (!flying_ && !brings_down(one)) return Error{"the ledger is not reached yet: nothing can fly"};
  post_command(one);
  return done;
}

void Ground::ask(service::MissionAsk asked, std::function<void(service::ApiAnswer)> answer) {
  if (!flying_) return answer(service::refusal(503, "the ledger is not reached yet"));
  missions_->ask(std::move(asked), std::move(answer));
}

void Ground::show(TimeNs now_ns) {
  if (!server_ || now_ns < next_show_ns_) return;
  next_show_ns_ = now_ns + (server_->watched() ? show_gap_ns : unwatched_gap_ns);
  service::Telling telling{.drones = service::Board::drones(now_ns, view_)};
  telling.paths = board_.changed_paths(view_);
  telling.state = service::Board::state_message(now_ns, view_, telling.drones);
  telling.aloft = service::aloft_of(view_);
  telling.stopped_by_ground = service::stopped_by_ground(view_);
  telling.events = std::exchange(unshown_, {});
  server_->publish(std::move(telling));
}

void Ground::note(const fabric::Block& block) {
  if (!server_) return;
  unshown_blocks_.push_back(
      service::summary_of(block, monotonic_ns(), self_->now()->serialized, view_.config().where.contract));
  if (server_->watched() || unshown_blocks_.size() >= service::max_reported_blocks)
    server_->publish_blocks(std::exchange(unshown_blocks_, {}));
}

Status Ground::open(std::size_t index, const Channel::Update& news, FlightInputs& inputs) {
  Channel& channel = *channels_[index];
  if (const auto* block = std::get_if<fabric::Block>(&news)) {
    const auto now = channel.take(*block);
    if (!now) return now.error();
    if (!*now) return done;
    inputs.block = block;
    certificate_ends_.note(*block);
    if (!roles_.empty()) roles_[index]->look(*block);
    if (index > 0) return done;  // missions are approved on the channel of [ledger], whose blocks the page shows
    note(*block);
    if (missions_) missions_->look(*block);
  } else if (const auto* ended = std::get_if<Channel::Ended>(&news)) {
    inputs.outcome = &ended->outcome;
    inputs.outcome_id = ended->id;
    if (!ended->outcome.unheard.empty() && monotonic_ns() >= next_unheard_log_ns_) {
      next_unheard_log_ns_ = monotonic_ns() + unheard_gap_ns;
      spdlog::warn("{}a call was endorsed by less than all peers that were asked: {}", channel.label(),
                   ended->outcome.unheard);
    }
    refusals_.take(ended->function, ended->outcome);
    if (ended->outcome.kind != fabric::Outcome::Kind::committed) {
      spdlog::warn("{}a command did not get through (block {}, code {}): {}", channel.label(), ended->outcome.block,
                   ended->outcome.code, ended->outcome.message);
    }
  } else if (const auto* read = std::get_if<Channel::ControlsRead>(&news)) {
    auto held = channel.take(*read);
    if (!held) return held.error();
    // The blocks that waited come next, before any that came behind them.
    std::vector<Event> next;
    for (fabric::Block& each : *held) next.push_back(OfChannel{index, std::move(each)});
    events_.insert(events_.begin(), std::make_move_iterator(next.begin()), std::make_move_iterator(next.end()));
  }
  return done;
}

Status Ground::open(const Event& event, std::vector<FlightInputs>& inputs) {
  if (const auto* of = std::get_if<OfChannel>(&event)) {
    if (lost_[of->channel]) return done;
    const Status opened = open(of->channel, of->news, inputs[of->channel]);
    if (opened || channels_.size() == 1) return opened;
    lose(of->channel, opened.error());
    return done;
  }
  if (const auto* reported = std::get_if<Report>(&event)) {
    unshown_.push_back(board_.tell(monotonic_ns(), reported->level, reported->drone, reported->words));
  } else if (const auto* change = std::get_if<SessionChange>(&event)) {
    change->in ? leaving_.remove(change->who) : leaving_.add(change->who, monotonic_ns());
  }
  return done;
}

// The other channels' drones must not lose their commander with it.
void Ground::lose(std::size_t channel, const Error& why) {
  lost_[channel] = true;
  std::string words = why.what + ". Its drones are asked to land, and are not flown any more";
  spdlog::error("{}", words);
  say(Level::alarm, "", std::move(words));
}

std::vector<std::vector<PilotCommand>> Ground::split(const std::vector<PilotCommand>& commands) const {
  std::vector<std::vector<PilotCommand>> of_each(channels_.size());
  for (const PilotCommand& command : commands) {
    const FlightView::Place place = view_.place(command.drone);
    of_each[place.channel].push_back(command);
    of_each[place.channel].back().drone = place.drone;
  }
  return of_each;
}

bool Ground::more_waits_for(std::size_t channel) const {
  return std::any_of(events_.begin(), events_.end(), [&](const Event& event) {
    const auto* of = std::get_if<OfChannel>(&event);
    return !of || of->channel == channel;
  });
}

Result<bool> Ground::run(const std::atomic<bool>& quit) {
  flying_ = true;
  // Whose drones an earlier ground left to us may come back for them.
  for (std::size_t who = 0; service_ && who < service_->operators().size(); ++who)
    leaving_.add(who, monotonic_ns() + session_idle_ns_);
  TimeNs leave_ns = 0;
  while (!view_.done()) {
    const auto event = next_event(tick_ns);
    std::vector<FlightInputs> inputs(channels_.size());
    if (event) {
      if (auto status = open(*event, inputs); !status) return status.error();
    }
    if (events_.empty()) events_ = mailbox_.take_all();
    const std::vector<std::vector<PilotCommand>> commands = split(take_commands());
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      inputs[i].commands = commands[i];
      inputs[i].more = more_waits_for(i);
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
    dismiss(now_ns);
    if (!leaving_.empty()) end_session(now_ns);
    tell_certificates(now_ns);
    show(now_ns);
    if (output_.status_period_ns > 0 && now_ns >= next_status_ns_) write_status(now_ns);
  }
  if (output_.status_period_ns > 0) write_status(monotonic_ns());
  flying_ = false;  // from here on the page is answered that nothing flies
  if (server_) {
    next_show_ns_ = 0;
    show(monotonic_ns());
    server_->end();
  }
  if (auto status = write_summary(); !status) return status.error();
  return view_.ok();
}

void Ground::step(std::vector<FlightInputs> inputs) {
  std::vector<std::string> notes;
  for (std::size_t i = 0; i < channels_.size(); ++i) {
    inputs[i].realtime_s = realtime_ns() / ns_per_s;
    FlightOutputs out = channels_[i]->core().step(monotonic_ns(), inputs[i]);
    act(i, out);
    for (std::string& note : out.notes) notes.push_back(std::move(note));
  }
  for (const std::string& note : notes) spdlog::warn("{}", note);
  if (!server_) return;
  for (service::Event& event : board_.look(monotonic_ns(), view_, notes)) unshown_.push_back(std::move(event));
  for (service::Event& event : board_.refusals(monotonic_ns(), refusals_)) unshown_.push_back(std::move(event));
}

void Ground::act(std::size_t index, FlightOutputs& out) {
  Channel& channel = *channels_[index];
  for (Submission& submission : out.submissions) {
    // A stop whose stopper has signed out meanwhile is ground's own.
    if (submission.by && service_->stop(*submission.by, index, submission.call, channel.on_end(submission))) continue;
    channel.submit(std::move(submission));
  }
  recorder_.add(out.traces);
  for (DroneUpdate& news : out.news) {
    news.drone = view_.drone_at({index, news.drone});
    publish(index, news);
  }
}

void Ground::publish(std::size_t channel, const DroneUpdate& news) {
  const std::string& drone = names_[news.drone];
  for (std::size_t i = 0; i < drone_topics.size(); ++i) {
    const DroneTopic& topic = drone_topics[i];
    const auto message = topic.make(news, drone);
    Status published = message ? done : Status(message.error());
    if (message && !message->empty()) published = writers_[i][topic.of_all ? 0 : news.drone].publish(*message);
    if (published) continue;
    ++news_unpublished_[channel];
    if (monotonic_ns() < next_warning_ns_) continue;
    next_warning_ns_ = monotonic_ns() + warning_gap_ns;
    spdlog::warn("{}: {}", topic_of(topic, drone), published.error().what);
  }
}

ShellCounters Ground::losses_of(std::size_t channel) const {
  ShellCounters counters;
  counters.pilots.assign(view_.of_channel(channel).drones().size(), {});
  for (std::size_t i = 0; pilots_ && i < names_.size(); ++i) {
    const FlightView::Place place = view_.place(i);
    if (place.channel == channel) counters.pilots[place.drone] = pilots_->losses(i);
  }
  counters.confirmed_after_ms = channels_[channel]->confirmed_after_ms();
  counters.news_unpublished = news_unpublished_[channel];
  return counters;
}

void Ground::write_status(TimeNs now_ns) {
  next_status_ns_ = now_ns + output_.status_period_ns;
  print_status(status_line(view_, certificates_ ? std::optional(certificates_->days_left()) : std::nullopt));
}

Status Ground::write_summary() {
  return recorder_.end(output_.summary, [this] {
    std::vector<std::string> of_each;
    for (std::size_t i = 0; i < channels_.size(); ++i) of_each.push_back(summary(channels_[i]->core(), losses_of(i)));
    return of_each.size() == 1 ? of_each.front() : summary_of_all(of_each);
  });
}

}  // namespace ledgerline::ground
