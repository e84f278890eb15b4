#include "ground/shell/ground.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <iterator>

#include "common/base/log.hpp"
#include "common/rt/retry/keep_trying.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground {
namespace {

constexpr TimeNs unheard_gap_ns = 10 * ns_per_s;  // a peer may be away for long
constexpr TimeNs tick_ns = 20 * ns_per_ms;        // for time-outs and signals; blocks and outcomes wake at once
constexpr TimeNs landing_limit_ns = 15 * ns_per_s;
constexpr TimeNs warning_gap_ns = ns_per_s;
constexpr TimeNs show_gap_ns = ns_per_s / 30;      // for whoever looks at the page
constexpr TimeNs unwatched_gap_ns = ns_per_s / 2;  // while nobody does

std::vector<std::string> names_of(const FlightCore& core) {
  std::vector<std::string> names;
  for (const FlightDrone& drone : core.drones()) names.push_back(drone.name);
  return names;
}

}  // namespace

Ground::Ground(FlightConfig flight, OutputSettings output, dds::ParticipantPtr participant,
               std::unique_ptr<fabric::Client> client, std::unique_ptr<fabric::Client> urgent,
               fabric::KeptCheckpoint kept)
    : output_(std::move(output)),
      core_(std::move(flight)),
      names_(names_of(core_)),
      participant_(std::move(participant)),
      refusals_(names_),
      kept_(std::move(kept)),
      client_(std::move(client)),
      urgent_(std::move(urgent)) {}

Ground::~Ground() {
  mailbox_.close();
  if (missions_) missions_->close();
  if (desk_) desk_->close();
  if (faults_) faults_->close();
}

std::optional<Ground::Letter> Ground::next_letter(TimeNs timeout_ns) {
  if (letters_.empty()) {
    mailbox_.wait(timeout_ns);
    letters_ = mailbox_.take_all();
  }
  if (letters_.empty()) return std::nullopt;
  Letter letter = std::move(letters_.front());
  letters_.pop_front();
  return letter;
}

std::vector<PilotWish> Ground::take_wishes() {
  const std::lock_guard lock(wishes_mutex_);
  return std::exchange(wishes_, {});
}

Status Ground::start(const std::atomic<bool>& quit) {
  if (auto status = recorder_.open(output_.trace); !status) return status;
  if (auto status = open_topics(); !status) return status;
  start_certificates();
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [this](const fabric::Block& block, std::string_view) { mailbox_.put_in_turn(block); };
  handlers.on_connection = [this](bool connected, const std::string& why) {
    if (connected) {
      spdlog::info("block stream connected");
    } else {
      spdlog::warn("block stream: {}", why);
    }
    mailbox_.put(StreamState{connected, why});
  };
  handlers.on_unbelievable = [](const std::string& what) { spdlog::warn("{}", what); };
  handlers.on_contradiction = [last = std::string()](const std::string& what) mutable {
    if (std::exchange(last, what) != what) spdlog::error("the ledger's blocks contradict what is known: {}", what);
  };
  handlers.on_confirmed = [this](const auto& confirmed) {
    confirmations_.add(confirmed.ordered_ns, confirmed.confirmed_ns);
  };
  handlers.on_orderers = fabric::tell_orderers;
  blocks_ = fabric::kept_blocks(*client_, std::move(kept_), std::move(handlers));
  if (auto status = wait_for_block_stream(quit); !status) return status;
  const auto controls = belief::read_controls(names_, [this](const fabric::Call& c) { return client_->evaluate(c); });
  if (!controls) return controls.error();
  if (auto status = set_controls(*controls); !status) return status;
  if (missions_) {
    if (auto status = missions_->restore(); !status) return status;
  }
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
  wish(drone, std::nullopt, [&](PilotWish& wished) { topic.take(cdr, monotonic_ns(), wished); });
}

void Ground::wish(std::size_t drone, const std::optional<crypto::IdentityName>& by,
                  const std::function<void(PilotWish&)>& change) {
  {
    const std::lock_guard lock(wishes_mutex_);
    auto wished = std::find_if(wishes_.begin(), wishes_.end(),
                               [&](const PilotWish& w) { return w.drone == drone && w.by == by; });
    if (wished == wishes_.end()) wished = wishes_.insert(wished, {.drone = drone, .by = by});
    change(*wished);
  }
  mailbox_.wake();
}

void Ground::say(Level level, const std::string& drone, std::string words) {
  mailbox_.put(Told{level, drone, std::move(words)});
}

void Ground::wish(const PilotWish& one) {
  wish(one.drone, one.by, [&](PilotWish& wished) { service::merge(one, wished); });
}

Status Ground::open_desk(const std::string& folder, const fabric::ClientConfig& ledger) {
  auto desk = OperatorDesk::create({.folder = folder,
                                    .ledger = ledger,
                                    .drones = names_,
                                    .tell = std::bind_front(&Ground::say, this),
                                    .on_session = [this](std::size_t who, bool in) {
                                      mailbox_.put(SessionChange{who, in});
                                    }});
  if (!desk) return Error{"[service] operators: " + desk.error().what};
  desk_ = std::move(*desk);
  return done;
}

void Ground::see_off(TimeNs now_ns) {
  for (const std::size_t who : leaving_.all()) {
    const crypto::IdentityName& identity = desk_->operators()[who].identity;
    const service::Held held = service::held_by(core_, identity);
    const service::Leaving::Step step = leaving_.step(now_ns, who, held);
    for (const std::size_t drone : step.land) wish({.drone = drone, .by = identity, .land = true});
    // False: too much waits to be signed.
    if (step.give_back && (desk_->see_off(who, held.drones) || step.last)) leaving_.remove(who);
  }
}

void Ground::open_missions(service::MissionSettings settings) {
  settings.check.flight = core_.config().controller;
  missions_ = std::make_unique<MissionDesk>(MissionDesk::Parts{
      .settings = std::move(settings),
      .core = core_,
      .client = *urgent_,
      .sign = [this](std::size_t who, const service::OperatorCall& call) { return desk_->submit(who, call); },
      .signed_in = [this](std::size_t who) { return !leaving_.has(who); },
      .wish = [this](const PilotWish& one) { wish(one); },
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
                     const fabric::ClientConfig& ledger) {
  const FlightConfig& flight = core_.config();
  const service::Greeting greeting{.manual = flight.manual,
                                   .speed_mps = flight.controller.speed_mps,
                                   .cmd_timeout_ns = flight.cmd_timeout_ns,
                                   .fence = missions.check.fence};
  open_missions(std::move(missions));
  if (!settings.operators.empty()) {
    if (Status opened = open_desk(settings.operators, ledger); !opened) return opened;
  }
  self_ = ledger.identity.in_use;
  session_idle_ns_ = settings.session_idle_ns;
  service::Server::Behind behind{.take = [this](const PilotWish& one) { return take(one); },
                                 .keys = desk_.get(),
                                 .ask_missions =
                                     [this](service::MissionAsk asked, std::function<void(service::ApiAnswer)> answer) {
                                       ask(std::move(asked), std::move(answer));
                                     },
                                 .tell = [this](Level level, std::string words) { say(level, "", std::move(words)); }};
  if (!settings.faults.empty()) {
    faults_ = std::make_unique<service::FaultDesk>(settings.faults, std::bind_front(&Ground::say, this));
    behind.ask_faults = std::bind_front(&service::FaultDesk::ask, faults_.get());
  }
  auto server = service::Server::start(settings, names_, greeting, std::move(behind));
  if (!server) return server.error();
  server_ = std::move(server).value();
  if (faults_) faults_->start([this](service::FaultList list) { server_->publish_faults(std::move(list)); });
  show(monotonic_ns());
  return done;
}

// A stop may wait until the ledger is reached, and so may a landing; nobody wants another word then that he gave before.
Status Ground::take(const PilotWish& one) {
  if (!flying_ && !brings_down(one)) return Error{"the ledger is not reached yet: nothing can fly"};
  wish(one);
  return done;
}

void Ground::ask(service::MissionAsk asked, std::function<void(service::ApiAnswer)> answer) {
  if (!flying_) return answer(service::refusal(503, "the ledger is not reached yet"));
  missions_->ask(std::move(asked), std::move(answer));
}

void Ground::show(TimeNs now_ns) {
  if (!server_ || now_ns < next_show_ns_) return;
  next_show_ns_ = now_ns + (server_->watched() ? show_gap_ns : unwatched_gap_ns);
  service::Telling telling{.drones = service::Board::drones(now_ns, core_)};
  telling.paths = board_.changed_paths(core_);
  telling.state = service::Board::state_message(now_ns, core_, telling.drones);
  telling.aloft = service::aloft_of(core_);
  telling.events = std::exchange(unshown_, {});
  server_->publish(std::move(telling));
}

void Ground::note(const fabric::Block& block) {
  certificate_ends_.note(block);
  if (!server_) return;
  unshown_blocks_.push_back(
      service::summary_of(block, monotonic_ns(), self_->now()->serialized, core_.config().where.contract));
  if (server_->watched() || unshown_blocks_.size() >= service::max_told_blocks)
    server_->publish_blocks(std::exchange(unshown_blocks_, {}));
}

Status Ground::wait_for_block_stream(const std::atomic<bool>& quit) {
  const auto is_open = [this]() -> Status {
    FlightInputs unused;
    while (!stream_.connected) {
      const auto letter = next_letter(0);
      if (!letter) return Error{stream_.why.empty() ? "no answer yet" : stream_.why};
      if (auto status = open(*letter, unused); !status) return status;
    }
    return done;
  };
  return keep_trying(
      "the ledger's blocks can be read", {}, [&] { return quit.load(); }, is_open);
}

Status Ground::set_controls(const std::vector<Control>& controls) {
  for (const Control& control : controls) {
    if (auto status = core_.set_control(control.SerializeAsString()); !status) return status;
  }
  return done;
}

Status Ground::open(const Letter& letter, FlightInputs& inputs) {
  if (const auto* block = std::get_if<fabric::Block>(&letter)) {
    const auto next = control_start_.on_block(*block);
    if (!next) return next.error();
    if (*next == belief::ControlStart::Next::take) {
      inputs.block = block;
      note(*block);
      if (missions_) missions_->look(*block);
    }
    if (*next != belief::ControlStart::Next::read) return done;
    control_reader_ = std::jthread([this](const std::stop_token& stop) {
      auto controls = belief::keep_reading_controls(
          stop, names_, [this](const fabric::Call& call) { return client_->evaluate(call); });
      if (!stop.stop_requested()) mailbox_.put(ControlsRead{std::move(controls)});
    });
  } else if (const auto* ended = std::get_if<Ended>(&letter)) {
    inputs.outcome = &ended->outcome;
    inputs.outcome_id = ended->id;
    if (!ended->outcome.unheard.empty() && monotonic_ns() >= next_unheard_log_ns_) {
      next_unheard_log_ns_ = monotonic_ns() + unheard_gap_ns;
      spdlog::warn("a call was endorsed by less than all peers that were asked: {}", ended->outcome.unheard);
    }
    refusals_.take(ended->function, ended->outcome);
    if (ended->outcome.kind != fabric::Outcome::Kind::committed) {
      spdlog::warn("a command did not get through (block {}, code {}): {}", ended->outcome.block, ended->outcome.code,
                   ended->outcome.message);
    }
  } else if (const auto* state = std::get_if<StreamState>(&letter)) {
    stream_ = *state;
  } else if (const auto* told = std::get_if<Told>(&letter)) {
    unshown_.push_back(board_.tell(monotonic_ns(), told->level, told->drone, told->words));
  } else if (const auto* change = std::get_if<SessionChange>(&letter)) {
    change->in ? leaving_.remove(change->who) : leaving_.add(change->who, monotonic_ns());
  } else if (const auto* read = std::get_if<ControlsRead>(&letter)) {
    if (!read->controls) return read->controls.error();
    // The blocks that waited come next, before any that came behind them.
    std::vector<fabric::Block> held = control_start_.on_read();
    letters_.insert(letters_.begin(), std::make_move_iterator(held.begin()), std::make_move_iterator(held.end()));
    return set_controls(*read->controls);
  }
  return done;
}

Result<bool> Ground::run(const std::atomic<bool>& quit) {
  flying_ = true;
  // Whose drones an earlier ground left to us may come back for them.
  for (std::size_t who = 0; desk_ && who < desk_->operators().size(); ++who)
    leaving_.add(who, monotonic_ns() + session_idle_ns_);
  TimeNs leave_ns = 0;
  while (!core_.done()) {
    const auto letter = next_letter(tick_ns);
    FlightInputs inputs;
    if (letter) {
      if (auto status = open(*letter, inputs); !status) return status.error();
    }
    if (letters_.empty()) letters_ = mailbox_.take_all();
    const std::vector<PilotWish> wishes = take_wishes();
    inputs.wishes = wishes;
    inputs.more = !letters_.empty();
    const TimeNs now_ns = monotonic_ns();
    if (quit && leave_ns == 0) {
      spdlog::info("asked to end: landing all drones");
      inputs.land = "asked to land";
      leave_ns = now_ns + landing_limit_ns;
    }
    step(inputs);
    if (missions_) missions_->step(now_ns);
    if (leave_ns != 0 && now_ns > leave_ns) {
      spdlog::error("not all drones were seen to land within {:.0f} s", to_seconds(landing_limit_ns));
      break;
    }
    if (!leaving_.empty()) see_off(now_ns);
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
  return core_.ok();
}

void Ground::step(FlightInputs inputs) {
  inputs.realtime_s = realtime_ns() / ns_per_s;
  FlightOutputs out = core_.step(monotonic_ns(), inputs);
  for (Submission& submission : out.submissions) {
    auto ended = [this, id = submission.id, function = submission.call.function](fabric::Outcome outcome) {
      mailbox_.put(Ended{id, function, std::move(outcome)});
    };
    // A stop whose stopper has signed out meanwhile is ground's own.
    if (submission.by && desk_->stop(*submission.by, submission.call, ended)) continue;
    (submission.urgent ? urgent_ : client_)->submit(std::move(submission.call), std::move(ended));
  }
  recorder_.add(out.traces);
  for (const std::string& note : out.notes) spdlog::warn("{}", note);
  if (server_) {
    for (service::Event& event : board_.look(monotonic_ns(), core_, out.notes)) unshown_.push_back(std::move(event));
    for (service::Event& event : board_.refusals(monotonic_ns(), refusals_)) unshown_.push_back(std::move(event));
  }
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
  fmt::print("{}\n", status_line(core_, certificates_ ? std::optional(certificates_->days_left()) : std::nullopt));
  std::fflush(stdout);
}

Status Ground::write_summary() {
  return recorder_.end(output_.summary, [this] {
    count_losses();
    counters_.confirmed_after_ms = confirmations_.quantiles_ms();
    return summary(core_, counters_);
  });
}

}  // namespace ledgerline::ground
