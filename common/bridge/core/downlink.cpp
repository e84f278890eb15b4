#include "common/bridge/core/downlink.hpp"

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>

#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/rt/histogram.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline::bridge {
namespace {

AssetView view_of(const Asset& asset) {
  AssetView view{.id = asset.id(), .type = asset.msg_type(), .cdr = asset.msg_data(), .origin = {}};
  if (asset.has_origin())
    view.origin = {asset.origin().writer(), asset.origin().life(), asset.origin().sequence(),
                   asset.origin().stamp_ns()};
  return view;
}

/// Of the same writer, and not newer.
bool had(const Origin& newest, const Origin& other) {
  return newest.writer == other.writer &&
         (other.life < newest.life || (other.life == newest.life && other.sequence <= newest.sequence));
}

/// CDR as ROS 2 sends it: PLAIN_CDR in either byte order, behind its four bytes.
bool is_cdr(std::string_view bytes) { return bytes.size() >= 4 && bytes[0] == 0 && (bytes[1] == 0 || bytes[1] == 1); }

}  // namespace

Downlink::Downlink(DownlinkConfig config, crypto::MspRegistry& trusted)
    : config_(std::move(config)), trusted_(trusted) {}

void Downlink::on_block(TimeNs real_now, const fabric::Block& block, std::vector<Delivery>& out) {
  held_.clear();
  for (const fabric::Transaction& tx : block.transactions) {
    if (!tx.problem.empty()) ++unverified_transactions_;
    if (tx.code != 0 || tx.config || tx.event_name != contract::set || tx.contract != config_.contract) continue;
    // A peer could have put other messages into the event than its writer signed.
    if (!verification::reports_set({tx.function, tx.args}, tx.event_payload)) {
      ++unverified_transactions_;
      continue;
    }
    const std::string& payload = tx.event_payload.empty() ? tx.args[0] : tx.event_payload;
    if (is_json(payload)) {
      auto call = std::make_unique<SetCall>();
      if (!parse_message(payload, *call)) {
        ++malformed_frames_;
        continue;
      }
      set_.assets.clear();
      set_.stream = call->stream();
      for (const Asset& asset : call->assets()) set_.assets.push_back(view_of(asset));
      held_.push_back(std::move(call));
    } else if (!read_set(payload, set_)) {
      ++malformed_frames_;
      continue;
    }
    carry(real_now, tx, set_, out);
  }
}

Downlink::Match Downlink::match(std::string_view id) {
  const std::string_view topic = ros_topic_of(id, name_buffer_);
  if (topic.size() < 2) return {};
  const Rule* rule = rule_down(config_.rules, topic, id);
  if (!rule || !is_wildcard(*rule) || !is_guarded(topic)) return {rule, false};
  if (const Rule* named = rule_down(config_.rules, topic, id, true)) return {named, false};
  return {rule, true};
}

// Ids beyond the bounds share one topic, which only counts them.
std::size_t Downlink::topic_of(std::string_view id, const Match& match, bool strange) {
  const auto of_one = ids_of_.find(first_segment(id));
  const bool beyond = by_id_.size() == max_ids || (of_one != ids_of_.end() && of_one->second == max_ids_of_one) ||
                      (strange && strange_ids_ == max_unauthorised_ids);
  if (beyond && further_) return *further_;
  topics_.push_back({.name = beyond ? "(further topics)" : std::string(ros_topic_of(id, name_buffer_)),
                     .id = beyond ? "" : std::string(id),
                     .type = match.rule->type,
                     .rule = match.rule,
                     .withheld = !beyond && match.withheld,
                     .counters = {}});
  slots_.emplace_back();
  const std::size_t index = topics_.size() - 1;
  if (beyond) {
    further_ = index;
  } else {
    by_id_.emplace(id, index);
    if (strange) ++strange_ids_;
    ++ids_of_[std::string(first_segment(id))];
  }
  return index;
}

std::optional<Refusal> Downlink::unpublishable(std::size_t topic, const AssetView& asset) const {
  if (topic == further_) return Refusal::too_many;
  const std::string& wanted = topics_[topic].rule->type;
  // DDS has one type of a topic in a process: the id that brought it first may change it, another one may not.
  const auto first = by_ros_name_.find(topics_[topic].name);
  const bool has_type =
      first == by_ros_name_.end() || first->second == topic || topics_[first->second].type == asset.type;
  if (!is_ros_type(asset.type) || (!wanted.empty() && wanted != asset.type) || !has_type) return Refusal::wrong_type;
  return is_cdr(asset.cdr) ? std::nullopt : std::optional(Refusal::malformed);
}

void Downlink::identify(TimeNs real_now, const fabric::Transaction& tx, Signer& signer) {
  signer.known = true;
  signer.hash = std::hash<std::string>{}(tx.creator);
  const auto member = trusted_.member(tx.creator, real_now / ns_per_s);
  if (!member) return;
  signer.name = (*member)->name;
  signer.verified = fabric::verify_signature(tx, *(*member)->verifier);
}

bool Downlink::may_write(const Signer& signer, std::string_view id) {
  const std::string_view owner = first_segment(id);
  return !is_msp_id(owner) || owner == signer.name.msp_id;
}

void Downlink::carry(TimeNs real_now, const fabric::Transaction& tx, const SetView& set, std::vector<Delivery>& out) {
  Signer signer;
  for (const AssetView& asset : set.assets) {
    const auto known = by_id_.find(asset.id);
    std::size_t index = 0;
    if (known != by_id_.end()) {
      index = known->second;
    } else if (!is_ledger_id(asset.id)) {
      ++unverified_transactions_;
      return;
    } else {
      const Match found = match(asset.id);
      if (!found.rule) continue;
      if (!signer.known) identify(real_now, tx, signer);
      index = topic_of(asset.id, found, !signer.verified || !may_write(signer, asset.id));
    }
    Topic& topic = topics_[index];
    Slot& slot = slots_[index];
    ++topic.counters.taken;
    if (slot.last_tx != tx.tx_id) ++topic.counters.batches;
    slot.last_tx = tx.tx_id;
    if (topic.withheld) {
      refuse(topic, Refusal::unnamed);
      continue;
    }
    if (!signer.known) identify(real_now, tx, signer);
    if (asset.origin.writer == config_.writer || (asset.origin.writer == 0 && signer.name == config_.self)) {
      refuse(topic, Refusal::echo);
    } else if (!signer.verified) {
      refuse(topic, Refusal::unverified);
    } else if (!may_write(signer, asset.id)) {
      refuse(topic, Refusal::wrong_writer);
    } else if (const auto why = unpublishable(index, asset)) {
      refuse(topic, *why);
    } else if (accept_in_order(slot, topic, asset, signer.hash, set.stream)) {
      deliver(real_now, index, asset, out);
    }
  }
}

bool Downlink::accept_in_order(Slot& slot, Topic& topic, const AssetView& asset, std::uint64_t signer, bool stream) {
  auto writer = std::ranges::find_if(
      slot.writers, [&](const Writer& w) { return w.origin == asset.origin.writer && w.signer == signer; });
  const bool first = writer == slot.writers.end();
  if (first) {
    if (slot.writers.size() == max_writers) {
      refuse(topic, Refusal::too_many);
      return false;
    }
    slot.writers.push_back({.origin = asset.origin.writer, .signer = signer, .life = 0, .sequence = 0, .newest = {}});
    writer = slot.writers.end() - 1;
  }
  if (asset.origin.writer == 0) {
    // Without a sequence a value that a batch carries along is known by its bytes.
    const bool repeated = stream && !first && writer->newest == asset.cdr;
    if (stream) writer->newest = asset.cdr;
    if (repeated) refuse(topic, Refusal::repeated);
    return !repeated;
  }
  const Origin newest{writer->origin, writer->life, writer->sequence};
  if (had(newest, asset.origin) || had(slot.got, asset.origin)) {
    const Origin& same = newest.life == asset.origin.life ? newest : slot.got;
    const bool again = same.life == asset.origin.life && same.sequence == asset.origin.sequence;
    refuse(topic, again ? Refusal::repeated : Refusal::duplicate);
    return false;
  }
  if (asset.origin.life == writer->life) topic.counters.missing += asset.origin.sequence - writer->sequence - 1;
  writer->life = asset.origin.life;
  writer->sequence = asset.origin.sequence;
  return true;
}

void Downlink::deliver(TimeNs real_now, std::size_t topic, const AssetView& asset, std::vector<Delivery>& out) {
  Topic& shown = topics_[topic];
  by_ros_name_.try_emplace(shown.name, topic);
  if (shown.type != asset.type) shown.type = asset.type;
  ++shown.counters.published;
  shown.counters.bytes += asset.cdr.size();
  const TimeNs source_ns = std::max<TimeNs>(asset.origin.stamp_ns, 0);  // an outsider may claim any
  if (source_ns != 0) shown.counters.age.add(real_now - source_ns);
  out.push_back({.topic = topic,
                 .type = asset.type,
                 .cdr = {reinterpret_cast<const std::uint8_t*>(asset.cdr.data()), asset.cdr.size()},
                 .source_ns = source_ns});
}

void Downlink::refuse(Topic& topic, Refusal why) {
  ++topic.counters.refusals[static_cast<std::size_t>(why)];
  if (why == Refusal::wrong_writer || why == Refusal::unverified || why == Refusal::wrong_type ||
      why == Refusal::malformed || why == Refusal::too_many)
    refused_ = {topic.id, why};
}

void Downlink::on_failure(std::size_t topic) {
  --topics_[topic].counters.published;
  refuse(topics_[topic], Refusal::dds);
}

std::vector<std::string> Downlink::latched() const {
  std::vector<std::string> ids;
  for (const Rule& rule : config_.rules) {
    if (!rule.latched || !rule.from_ledger || rule.left_out) continue;
    // Up to the "*", by whole segments; what does not match is left out when it comes.
    std::string id = is_msp_id(rule.from) ? rule.from + rule.name : rule.name.substr(1);
    if (const auto star = id.find('*'); star != std::string::npos) {
      const auto slash = id.rfind('/', star);
      id = (slash == std::string::npos ? rule.from : id.substr(0, slash)) + "/*";
    }
    if (first_segment(id) == rule.from && std::ranges::find(ids, id) == ids.end()) ids.push_back(id);
  }
  return ids;
}

// The contract let only an owner write them, and an answer of `get` has no signature: it is accepted from the peer
// unverified.
void Downlink::on_values(TimeNs real_now, const Assets& values, std::vector<Delivery>& out) {
  for (const Asset& value : values.assets()) {
    const AssetView asset = view_of(value);
    if (!is_ledger_id(asset.id)) continue;
    const Match found = match(asset.id);
    if (!found.rule || !found.rule->latched || asset.origin.writer == config_.writer || by_id_.contains(asset.id))
      continue;
    const std::size_t index = topic_of(asset.id, found, false);
    Topic& topic = topics_[index];
    ++topic.counters.taken;
    if (topic.withheld) {
      refuse(topic, Refusal::unnamed);
    } else if (const auto why = unpublishable(index, asset)) {
      refuse(topic, *why);
    } else {
      slots_[index].got = asset.origin;
      deliver(real_now, index, asset, out);
    }
  }
}

nlohmann::json report(const Downlink& downlink) {
  nlohmann::json topics = nlohmann::json::array();
  for (const Downlink::Topic& topic : downlink.topics()) {
    const DownlinkCounters& c = topic.counters;
    topics.push_back({{"topic", topic.name},
                      {"type", topic.type},
                      {"id", topic.id},
                      {"direction", "from_ledger"},
                      {"taken", c.taken},
                      {"messages", c.published},
                      {"bytes", c.bytes},
                      {"batches", c.batches},
                      {"missing", c.missing},
                      {"age_ms", c.age.quantiles_ms()},
                      {"drops", reasons<Refusal>(c.refusals)}});
  }
  return topics;
}

}  // namespace ledgerline::bridge
