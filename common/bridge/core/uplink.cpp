#include "common/bridge/core/uplink.hpp"
#include "common/rt/histogram.hpp"
#include "common/verification/calls.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <utility>

namespace ledgerline::bridge {
namespace {

constexpr std::size_t max_spare = 4'096;
constexpr TimeNs active_ns = 1 * ns_per_s;  // a topic that was heard within

/// What the log says of the first; empty: nothing.
std::string_view words_of(Drop why) {
  switch (why) {
    case Drop::too_big:
      return "a message is above 999 kB, or its host's stream above 32 kB: it is not carried";
    case Drop::overflow:
      return "messages come faster than the ledger takes them: the oldest that wait are dropped";
    case Drop::unavailable:
      return "a message is dropped: its call did not get through, and a newer one did";
    case Drop::rate:
    case Drop::replaced:
    case Drop::refused:
    case Drop::type_changed:
      break;
  }
  return "";
}

}  // namespace

Uplink::Uplink(UplinkConfig config) : config_(std::move(config)), lanes_(kinds, Lane(config_)), random_(config_.seed) {}

Result<std::size_t> Uplink::open(const std::string& ros_topic, const std::string& type) {
  const Rule* rule = rule_up(config_.rules, ros_topic);
  if (!rule) return Error{ros_topic + ": no [[topic]] takes it to the ledger"};
  if (!is_ros_type(type)) return Error{fmt::format("{}: \"{}\" is no ROS 2 type", ros_topic, type)};
  if (!rule->type.empty() && rule->type != type)
    return Error{fmt::format("{}: its type is {}, its [[topic]] says {}", ros_topic, type, rule->type)};
  const auto known = std::ranges::find_if(topics_, [&](const Topic& topic) { return topic.name == ros_topic; });
  const auto index = static_cast<std::size_t>(known - topics_.begin());
  if (known == topics_.end()) {
    if (topics_.size() == max_topics)
      return Error{fmt::format("{}: {} topics are carried already", ros_topic, max_topics)};
    topics_.push_back({.name = ros_topic,
                       .id = ledger_id(ros_topic, config_.msp_id, config_.enrolled),
                       .type = type,
                       .rule = rule,
                       .counters = {}});
    slots_.emplace_back(rule->queue);
    slots_.back().kind = rule->stream ? stream : own;
  } else if (known->type != type) {
    known->type = type;
    Slot& slot = slots_[index];
    ++slot.generation;
    slot.has_newest = false;
    while (!slot.queue.empty()) drop(pop(index), Drop::type_changed);
  }
  return index;
}

std::size_t Uplink::size_of(const Message& message) const {
  const Topic& topic = topics_[message.topic];
  return topic.id.size() + topic.type.size() + message.cdr.size() + asset_overhead;
}

void Uplink::add(TimeNs now, std::size_t topic, TimeNs source_ns, std::span<const std::uint8_t> cdr) {
  Topic& shown = topics_[topic];
  Slot& slot = slots_[topic];
  const Rule& rule = *shown.rule;
  ++shown.counters.taken;
  ++shown.counters.pending;
  slot.heard_ns = now;
  Message message;
  message.topic = topic;
  const bool nth = slot.seen++ % static_cast<std::uint64_t>(rule.every) == 0;
  const TimeNs period_ns = rule.rate_hz > 0 ? from_seconds(1 / rule.rate_hz) : 0;
  // Half a period early is on time, or jitter would cost messages of a source that keeps the rate; the grid keeps it on
  // average. What a pause left out is not made up for.
  if (!nth || now < slot.next_by_rate_ns - period_ns / 2) return drop(std::move(message), Drop::rate);
  if (period_ns > 0) slot.next_by_rate_ns = std::max(slot.next_by_rate_ns, now) + period_ns;
  ++slot.sequence;  // from here on readers see a gap
  const std::size_t size = shown.id.size() + shown.type.size() + cdr.size() + asset_overhead;
  if (size > max_message_bytes) return drop(std::move(message), Drop::too_big);

  if (!spare_.empty()) {
    message.cdr = std::move(spare_.back());
    spare_.pop_back();
  }
  message.cdr.assign(reinterpret_cast<const char*>(cdr.data()), cdr.size());
  message.generation = slot.generation;
  message.sequence = slot.sequence;
  message.taken_ns = now;
  message.source_ns = source_ns;
  slot.big = slot.big || cdr.size() > big_bytes;
  while (slot.queue.full() || (!slot.queue.empty() && slot.queued_bytes + cdr.size() > max_queued_bytes))
    drop(pop(topic), rule.latest ? Drop::replaced : Drop::overflow);
  slot.queued_bytes += cdr.size();
  slot.queue.push_back(std::move(message));
  ++waiting_;
}

void Uplink::record_dds_losses(std::size_t topic, std::uint64_t lost, std::uint64_t refused) {
  Topic& of = topics_[topic];
  if (lost > 0 && of.counters.dds_lost == 0)
    notices_.push_back(of.name + ": DDS lost messages of it before they were taken");
  if (refused > 0 && of.counters.dds_refused == 0)
    notices_.push_back(of.name + ": a message is above 1,000,000 bytes, or no plain CDR: it is not carried");
  of.counters.dds_lost += lost;
  of.counters.dds_refused += refused;
}

void Uplink::drop(Message message, Drop why) {
  UplinkCounters& counters = topics_[message.topic].counters;
  --counters.pending;
  if (counters.drops[static_cast<std::size_t>(why)]++ == 0 && !words_of(why).empty())
    notices_.push_back(fmt::format("{}: {}", topics_[message.topic].name, words_of(why)));
  recycle(std::move(message));
}

void Uplink::recycle(Message message) {
  // A big one is rare: its memory is given back.
  if (message.cdr.capacity() > 0 && message.cdr.capacity() <= 2 * big_bytes && spare_.size() < max_spare)
    spare_.push_back(std::move(message.cdr));
}

Uplink::Message Uplink::pop(std::size_t topic) {
  Slot& slot = slots_[topic];
  --waiting_;
  slot.queued_bytes -= slot.queue.front().cdr.size();
  Message message = std::move(slot.queue.front());
  slot.queue.pop_front();
  return message;
}

bool Uplink::ready(const Lane& lane, Kind kind, TimeNs now) const {
  if (!lane.failed.empty() || !lane.pause.over(now)) return false;
  if (now - lane.in_flight.last_ns() < config_.min_gap_ns) return false;
  if (lane.in_flight.empty()) return true;
  return kind != bulk && !lane.in_flight.full() && lane.in_flight.may_go(now);
}

bool Uplink::must_yield(std::size_t big, TimeNs now) const {
  if (now >= bulk_again_ns_) return false;
  if (config_.beside) return true;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (!slots_[i].big && now - slots_[i].heard_ns < active_ns &&
        topics_[i].rule->priority > topics_[big].rule->priority)
      return true;
  }
  return false;
}

bool Uplink::assign_lane(std::size_t topic, Kind kind, TimeNs now) {
  Slot& slot = slots_[topic];
  if (slot.queue.empty() || slot.paused_until_ns > now) return false;
  // To another kind only when nothing is on its way, or its order would be left to two clients.
  if (slot.kind == own && slot.big && slot.in_flight == 0) slot.kind = bulk;
  return slot.kind == kind && !(slot.kind == own && slot.big);
}

std::optional<std::size_t> Uplink::first_topic(Kind kind, TimeNs now) {
  std::optional<std::size_t> first;
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (!assign_lane(i, kind, now)) continue;
    if (first) {
      const int priority = topics_[i].rule->priority, best = topics_[*first].rule->priority;
      const bool older = slots_[i].queue.front().taken_ns < slots_[*first].queue.front().taken_ns;
      if (priority < best || (priority == best && !older)) continue;
    }
    first = i;
  }
  return first;
}

std::optional<Uplink::Submit> Uplink::next(TimeNs now) {
  if (waiting_ == 0) return std::nullopt;
  for (const Kind kind : {own, stream, bulk}) {
    if (!ready(lanes_[kind], kind, now)) continue;
    if (auto call = make_call(kind, now)) return call;
  }
  return std::nullopt;
}

std::optional<Uplink::Submit> Uplink::make_call(Kind kind, TimeNs now) {
  Lane& lane = lanes_[kind];
  const auto foremost = first_topic(kind, now);
  if (!foremost || (kind == bulk && must_yield(*foremost, now))) return std::nullopt;
  const std::uint64_t number = ++last_number_;
  Messages messages;
  if (!spare_calls_.empty()) {
    messages = std::move(spare_calls_.back());
    spare_calls_.pop_back();
  }
  const std::size_t limit = kind == bulk ? big_bytes : max_call_bytes;
  std::size_t bytes = 0;
  while (const auto topic = first_topic(kind, now)) {
    Slot& slot = slots_[*topic];
    const std::size_t size = size_of(slot.queue.front());
    if (!messages.empty() && (bytes + size > limit || messages.size() == contract::max_call_assets - max_topics)) break;
    Message message = pop(*topic);
    if (kind == stream && !fits_batch(message)) {
      drop(std::move(message), Drop::too_big);
      continue;
    }
    bytes += size;
    ++slot.in_flight;
    if (kind == stream) {
      slot.newest = message;
      slot.has_newest = true;
      slot.last_call = number;
    }
    messages.push_back(std::move(message));
  }
  if (messages.empty()) return std::nullopt;
  std::string argument;
  argument.reserve(bytes + 2 + (kind == stream ? contract::max_batch_bytes : 0));
  for (const Message& message : messages) append(argument, message);
  if (kind == stream) {
    repeat_others(argument, number);
    append_stream(argument);
  }
  Submit submit{.number = number,
                .call = {.function = contract::set, .args = {}, .reported_by_block = true},
                .bulk = kind == bulk};
  submit.call.args.push_back(std::move(argument));
  if (kind == stream) submit.call.need = verification::batch_need();
  lane.in_flight.add(number, now, std::move(messages));
  return submit;
}

// The contract bounds the sum of the newest values, in which topics stand beside ids.
bool Uplink::fits_batch(const Message& message) const {
  std::size_t bytes = size_of(message) + topics_[message.topic].id.size();
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    if (i != message.topic && slots_[i].has_newest) bytes += size_of(slots_[i].newest) + topics_[i].id.size();
  }
  return bytes <= contract::max_batch_bytes;
}

// A host's batches have one key: what a call leaves out would soon be gone from `get`.
void Uplink::repeat_others(std::string& call, std::uint64_t number) {
  for (std::size_t i = 0; i < slots_.size(); ++i) {
    const Slot& slot = slots_[i];
    if (slot.has_newest && slot.last_call != number) append(call, slot.newest);
  }
}

void Uplink::append(std::string& call, const Message& message) const {
  const Topic& topic = topics_[message.topic];
  append_asset(call, {.id = topic.id,
                      .type = topic.type,
                      .cdr = message.cdr,
                      .origin = {config_.writer, config_.life, message.sequence, message.source_ns}});
}

void Uplink::finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome) {
  for (Lane& lane : lanes_) {
    auto ended = lane.in_flight.end(number, outcome);
    if (!ended) continue;
    Messages& messages = ended->what;
    if (&lane == &lanes_[bulk]) {
      const auto took_ns = static_cast<double>(now - ended->submitted_ns);
      bulk_again_ns_ = now + static_cast<TimeNs>(took_ns * (1 / config_.bulk_share - 1));
    }
    if (outcome.kind == fabric::Outcome::Kind::committed) {
      lane.pause.succeeded();
      for (Message& message : messages) {
        Slot& slot = slots_[message.topic];
        UplinkCounters& counters = topics_[message.topic].counters;
        --slot.in_flight;
        --counters.pending;
        ++counters.on_ledger;
        counters.bytes += message.cdr.size();
        counters.age.add(now - message.taken_ns);
        if (std::exchange(slot.last_batch, number) != number) ++counters.batches;
        slot.committed = std::max(slot.committed, message.sequence);
        recycle(std::move(message));
      }
    } else if (outcome.kind == fabric::Outcome::Kind::refused) {
      on_refused(now, lane, messages, outcome);
    } else {
      lane.pause.failed(now, random_);
      std::move(messages.begin(), messages.end(), std::back_inserter(lane.failed));
    }
    messages.clear();
    spare_calls_.push_back(std::move(messages));
    if (lane.in_flight.empty()) send_again(lane);
    return;
  }
}

// Of a refusal for one id the others go again.
void Uplink::on_refused(TimeNs now, Lane& lane, Messages& messages, const fabric::Outcome& outcome) {
  bool some = false;
  for (Message& message : messages) {
    if (!outcome.refusal || !names(*outcome.refusal, topics_[message.topic].id)) continue;
    slots_[message.topic].paused_until_ns = now + config_.refused_pause_ns;
    some = true;
  }
  if (!some) lane.pause.failed(now, random_);
  for (Message& message : messages) {
    Slot& slot = slots_[message.topic];
    if (some && slot.paused_until_ns <= now) {
      lane.failed.push_back(std::move(message));
    } else {
      slot.has_newest = false;
      --slot.in_flight;
      drop(std::move(message), Drop::refused);
    }
  }
}

void Uplink::send_again(Lane& lane) {
  // Calls end in any order.
  std::ranges::sort(lane.failed, [](const Message& a, const Message& b) { return a.sequence < b.sequence; });
  for (auto message = lane.failed.rbegin(); message != lane.failed.rend(); ++message) {
    Slot& slot = slots_[message->topic];
    --slot.in_flight;
    if (message->generation != slot.generation) {
      drop(std::move(*message), Drop::type_changed);
    } else if (slot.committed > message->sequence) {
      drop(std::move(*message), Drop::unavailable);
    } else if (slot.queue.full() || slot.queued_bytes + message->cdr.size() > max_queued_bytes) {
      drop(std::move(*message), topics_[message->topic].rule->latest ? Drop::replaced : Drop::overflow);
    } else {
      slot.queued_bytes += message->cdr.size();
      ++waiting_;
      slot.queue.push_front(std::move(*message));
    }
  }
  lane.failed.clear();
}

std::size_t Uplink::calls_in_flight() const {
  std::size_t count = 0;
  for (const Lane& lane : lanes_) count += lane.in_flight.size();
  return count;
}

nlohmann::json report(const Uplink& uplink) {
  nlohmann::json topics = nlohmann::json::array();
  for (const Uplink::Topic& topic : uplink.topics()) {
    const UplinkCounters& c = topic.counters;
    topics.push_back({{"topic", topic.name},
                      {"type", topic.type},
                      {"id", topic.id},
                      {"direction", "to_ledger"},
                      {"taken", c.taken},
                      {"messages", c.on_ledger},
                      {"bytes", c.bytes},
                      {"batches", c.batches},
                      {"pending", c.pending},
                      {"dds_lost", c.dds_lost},
                      {"dds_refused", c.dds_refused},
                      {"age_ms", c.age.quantiles_ms()},
                      {"drops", reasons<Drop>(c.drops)}});
    if (!topic.unheard.empty()) topics.back()["unheard"] = topic.unheard;
  }
  return topics;
}

}  // namespace ledgerline::bridge
