#include "common/bridge/shell/bridge.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "common/base/log.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/rt/retry.hpp"
#include "common/verification/calls.hpp"
#include "common/verification/control_records.hpp"

namespace ledgerline::bridge {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds busy_turn{1}, idle_turn{100};
constexpr TimeNs end_limit_ns = 1 * ns_per_s;
constexpr TimeNs try_again_after_ns = 1 * ns_per_s;
constexpr TimeNs losses_period_ns = 100 * ns_per_ms;
constexpr TimeNs warning_gap_ns = 1 * ns_per_s;
constexpr std::size_t max_seen = 4'096;
constexpr std::size_t max_unheard_warnings = 8;  // of a topic

UplinkConfig uplink_config(const BridgeConfig& config, const crypto::IdentityName& self) {
  const TimeNs began = realtime_ns();
  return {.rules = config.rules,
          .enrolled = config.enrolled,
          .msp_id = self.msp_id,
          .writer = writer_of(self, config.name),
          .life = static_cast<std::uint64_t>(began),
          .min_gap_ns = config.min_gap_ns,
          .bulk_share = config.bulk_share,
          .beside = config.beside,
          .seed = static_cast<std::uint64_t>(began)};
}

/// Opened at the start, whether somebody writes it or not.
bool is_named(const Rule& rule) { return rule.to_ledger && !rule.left_out && !rule.type.empty() && !is_wildcard(rule); }

dds::Qos qos_of(const Rule& rule) {
  return {.reliable = rule.reliable, .transient_local = rule.latched, .depth = rule.depth};
}

}  // namespace

void DownlinkWriters::on_block(const fabric::Block& block) {
  const std::lock_guard lock(mutex_);
  deliveries_.clear();
  downlink_.on_block(realtime_ns(), block, deliveries_);
  publish(deliveries_);
  const auto refused = downlink_.pop_refused();
  if (!refused || monotonic_ns() < next_warning_ns_) return;
  next_warning_ns_ = monotonic_ns() + warning_gap_ns;
  spdlog::warn("{}: a value of the ledger is not carried: {} (`ledgerline topics` counts them)", refused->id,
               name(refused->why));
}

Status DownlinkWriters::read_latched(const verification::Evaluate& evaluate) {
  for (const std::string& id : downlink_.latched()) {
    const Status read = verification::read_pages(id, evaluate, [this](const Assets& values) {
      const std::lock_guard lock(mutex_);
      deliveries_.clear();
      downlink_.on_values(realtime_ns(), values, deliveries_);
      publish(deliveries_);
      return done;
    });
    if (!read && !read.error().message.ends_with(": not found"))
      return Error{fmt::format("latched values of {} cannot be read: {}", id, read.error().message)};
  }
  return done;
}

void DownlinkWriters::publish(const std::vector<Downlink::Delivery>& deliveries) {
  for (const Downlink::Delivery& delivery : deliveries) {
    Output* output = output_for(delivery);
    if (!output || !output->writer->publish(delivery.cdr, delivery.source_ns)) downlink_.on_failure(delivery.topic);
  }
}

// Null where DDS has no writer for it, which is tried again after a while.
DownlinkWriters::Output* DownlinkWriters::output_for(const Downlink::Delivery& delivery) {
  const Downlink::Topic& topic = downlink_.topics()[delivery.topic];
  Output& output = outputs_[topic.name];
  if (output.writer && output.type == delivery.type) return &output;
  const TimeNs now = monotonic_ns();
  if (now < output.try_again_ns) return nullptr;
  if (output.writer) spdlog::info("{}: its type is {} now, it was {}", topic.name, delivery.type, output.type);
  output.writer.reset();
  output.type = delivery.type;
  auto writer = dds::RawWriter::create(participant_, topic.name, output.type, qos_of(*topic.rule));
  if (!writer) {
    output.try_again_ns = now + try_again_after_ns;
    spdlog::warn("{} of {}: {}", topic.name, topic.id, writer.error().message);
    return nullptr;
  }
  spdlog::info("{}: {} comes from the ledger ({})", topic.name, output.type, topic.id);
  output.writer = std::move(writer).value();
  return &output;
}

void DownlinkWriters::report_to(nlohmann::json& status, nlohmann::json& topics) {
  const std::lock_guard lock(mutex_);
  for (auto& topic : report(downlink_)) topics.push_back(std::move(topic));
  status["malformed_frames"] = downlink_.malformed_frames();
  status["unverified_transactions"] = downlink_.unverified_transactions();
}

Result<std::unique_ptr<Bridge>> Bridge::create(const BridgeConfig& config, const fabric::ClientConfig& ledger,
                                               crypto::MspRegistry& trusted, dds::ParticipantPtr participant,
                                               fabric::StoredCheckpoint kept) {
  const fabric::ClientConfig careful = verification::for_contract(ledger);
  auto client = fabric::Client::create(careful);
  if (!client) return client.error();
  auto bulk = fabric::Client::create(careful);
  if (!bulk) return bulk.error();
  return std::unique_ptr<Bridge>(new Bridge(config, ledger, trusted, std::move(participant), std::move(client).value(),
                                            std::move(bulk).value(), std::move(kept)));
}

Bridge::Bridge(const BridgeConfig& config, const fabric::ClientConfig& ledger, crypto::MspRegistry& trusted,
               dds::ParticipantPtr participant, std::unique_ptr<fabric::Client> client,
               std::unique_ptr<fabric::Client> bulk, fabric::StoredCheckpoint kept)
    : rules_(config.rules),
      channel_(ledger.where.channel),
      participant_(std::move(participant)),
      uplink_(uplink_config(config, ledger.identity.name)),
      down_({.rules = config.rules,
             .self = ledger.identity.name,
             .writer = writer_of(ledger.identity.name, config.name),
             .contract = ledger.where.contract},
            trusted, participant_),
      client_(std::move(client)),
      bulk_(std::move(bulk)),
      blocks_({.label = fmt::format("channel {}: ", channel_), .kept = std::move(kept)}) {}

void Bridge::end() {
  if (!client_) return;
  carrier_ = {};  // also closes the readers
  discovery_.reset();
  const TimeNs until_ns = monotonic_ns() + end_limit_ns;
  for (bool more = true; more && monotonic_ns() < until_ns;) {
    std::unique_lock lock(up_mutex_);
    up_wake_.wait_for(lock, busy_turn);
    auto call = uplink_.next(monotonic_ns());
    more = call || uplink_.has_waiting() || uplink_.calls_in_flight() > 0;
    lock.unlock();
    if (call) submit(std::move(*call));
  }
  blocks_.close();
  client_.reset();
  bulk_.reset();
}

Status Bridge::start(const std::atomic<bool>& quit) {
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [this](const fabric::Block& block, std::string_view) { down_.on_block(block); };
  blocks_.open(*client_, std::move(handlers));
  const Status open = retry(
      fmt::format("the blocks of channel {} can be read", channel_), {}, [&] { return quit.load(); },
      [this] { return blocks_.connection(); });
  if (!open) return open;
  // Behind the start of the block stream, so that no newer value can be missed between the two.
  const Status latched = down_.read_latched([&](const fabric::Call& call) {
    return quit ? Result<std::string>(Error{"asked to end"}) : client_->evaluate(call);
  });
  if (!latched) return latched;
  if (auto status = open_named_topics(); !status) return status;
  auto discovery = dds::Discovery::create(participant_, [this](const dds::DiscoveredTopic& seen) { on_seen(seen); });
  if (!discovery) return discovery.error();
  discovery_ = std::move(discovery).value();
  carrier_ = std::jthread([this](const std::stop_token& stop) { carry(stop); });
  return done;
}

Status Bridge::open_named_topics() {
  for (const Rule& rule : rules_) {
    if (!is_named(rule)) continue;
    if (auto status = open_reader(rule.name, rule.type, qos_of(rule)); !status) return status;
  }
  return done;
}

// On a thread of DDS.
void Bridge::on_seen(const dds::DiscoveredTopic& seen) {
  const std::lock_guard lock(up_mutex_);
  const auto same =
      std::ranges::find_if(seen_, [&](const auto& s) { return s.topic == seen.topic && s.type == seen.type; });
  if (same != seen_.end()) {
    *same = seen;
  } else if (seen_.size() < max_seen) {
    seen_.push_back(seen);
  } else {
    ++seen_left_out_;
  }
  up_wake_.notify_all();
}

void Bridge::update_topics() {
  std::vector<dds::DiscoveredTopic> seen;
  {
    const std::lock_guard lock(up_mutex_);
    seen.swap(seen_);
  }
  for (const dds::DiscoveredTopic& one : seen) {
    const Rule* rule = rule_up(rules_, one.topic);
    if (!rule) continue;
    if (!rule->type.empty() && rule->type != one.type) {
      if (inputs_.contains(one.topic))
        report_unheard(one);
      else if (one.writers > 0)
        spdlog::warn("{}: somebody writes {}, its [[topic]] says {}: not carried", one.topic, one.type, rule->type);
      continue;
    }
    auto& types = present_[one.topic];
    if (one.writers > 0) {
      types[one.type] = one.qos;
    } else {
      types.erase(one.type);
    }
    if (!is_named(*rule)) choose_type(one.topic);
    report_unheard(one);
    if (types.empty()) present_.erase(one.topic);
  }
}

void Bridge::report_unheard(const dds::DiscoveredTopic& seen) {
  const auto found = inputs_.find(seen.topic);
  if (found == inputs_.end()) return;
  Input& input = found->second;
  const std::string why = dds::why_unheard(seen, {seen.topic, input.type, input.qos});
  if (why.empty()) {
    input.unheard.erase(seen.type);
  } else {
    input.unheard[seen.type] = why;
    if (input.reported.size() < max_unheard_warnings && input.reported.insert(why).second) spdlog::warn("{}", why);
  }
  const std::lock_guard lock(up_mutex_);
  uplink_.set_unheard(input.index, input.unheard.empty() ? "" : input.unheard.begin()->second);
}

// The type that it has stays as long as somebody writes it.
void Bridge::choose_type(const std::string& topic) {
  const auto& types = present_[topic];
  const auto input = inputs_.find(topic);
  if (input != inputs_.end()) {
    if (types.contains(input->second.type)) return;
    spdlog::info("{}: nobody writes {} any more", topic, input->second.type);
    record_losses(input->second);
    {
      const std::lock_guard lock(up_mutex_);
      uplink_.set_unheard(input->second.index, "");
    }
    inputs_.erase(input);
  }
  if (types.empty()) return;
  const auto& [type, qos] = *types.begin();
  dds::Qos wanted = qos_of(*rule_up(rules_, topic));
  wanted.reliable = wanted.reliable && qos.reliable;
  wanted.transient_local = wanted.transient_local && qos.transient_local;
  if (auto status = open_reader(topic, type, wanted); !status) spdlog::warn("{}", status.error().message);
}

Status Bridge::open_reader(const std::string& topic, const std::string& type, const dds::Qos& qos) {
  std::size_t index = 0;
  {
    const std::lock_guard lock(up_mutex_);
    auto opened = uplink_.open(topic, type);
    if (!opened) return opened.error();
    index = *opened;
  }
  auto reader = dds::RawReader::create(participant_, topic, type, qos,
                                       [this, index](std::span<const std::uint8_t> cdr, const dds::RawInfo& info) {
                                         const std::lock_guard lock(up_mutex_);
                                         const bool idle = !uplink_.has_waiting();
                                         uplink_.add(monotonic_ns(), index, info.source_time_ns, cdr);
                                         if (idle) up_wake_.notify_all();
                                       });
  if (!reader) return reader.error();
  spdlog::info("{}: {} goes to the ledger", topic, type);
  inputs_[topic] = {.type = type, .index = index, .reader = std::move(reader).value(), .qos = qos};
  return done;
}

void Bridge::carry(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::optional<Uplink::Submit> call;
    {
      std::unique_lock lock(up_mutex_);
      if (seen_.empty()) up_wake_.wait_for(lock, uplink_.has_waiting() ? busy_turn : idle_turn);
      call = uplink_.next(monotonic_ns());
    }
    while (call) {
      submit(std::move(*call));
      const std::lock_guard lock(up_mutex_);
      call = uplink_.next(monotonic_ns());
    }
    update_topics();
    record_losses();
  }
  next_losses_ns_ = 0;
  record_losses();
  inputs_.clear();
}

void Bridge::record_losses() {
  const TimeNs now = monotonic_ns();
  if (now < next_losses_ns_) return;
  next_losses_ns_ = now + losses_period_ns;
  for (auto& [topic, input] : inputs_) record_losses(input);
  std::vector<std::string> notices;
  {
    const std::lock_guard lock(up_mutex_);
    notices = uplink_.pop_notices();
  }
  for (const std::string& notice : notices) spdlog::warn("{} (`ledgerline topics` counts them)", notice);
}

void Bridge::record_losses(Input& input) {
  const dds::Refused refusals = input.reader->refused();
  const std::uint64_t lost = input.reader->lost(), refused = refusals.total();
  const std::lock_guard lock(up_mutex_);
  uplink_.record_dds_losses(input.index, lost - std::exchange(input.dds_lost, lost),
                            refused - std::exchange(input.dds_refused, refused));
}

void Bridge::submit(Uplink::Submit call) {
  (call.bulk ? bulk_ : client_)->submit(std::move(call.call), [this, number = call.number](fabric::Outcome outcome) {
    const TimeNs now = monotonic_ns();
    const std::lock_guard lock(up_mutex_);
    if (outcome.kind != fabric::Outcome::Kind::committed && now >= next_warning_ns_) {
      next_warning_ns_ = now + warning_gap_ns;
      spdlog::warn("{}: a call did not get through (block {}, code {}): {}", channel_, outcome.block, outcome.code,
                   outcome.message);
    }
    uplink_.finished(now, number, outcome);
    up_wake_.notify_all();
  });
}

nlohmann::json Bridge::status() {
  nlohmann::json out = {{"channel", channel_}, {"connected", bool(blocks_.connection())}};
  nlohmann::json topics;
  {
    const std::lock_guard lock(up_mutex_);
    topics = report(uplink_);
    out["topics_left_out"] = seen_left_out_;
  }
  down_.report_to(out, topics);
  out["topics"] = std::move(topics);
  return out;
}

}  // namespace ledgerline::bridge
