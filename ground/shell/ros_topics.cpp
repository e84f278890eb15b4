#include "ground/shell/ros_topics.hpp"

#include <algorithm>

#include "common/base/log.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::ground {
namespace {

constexpr TimeNs warning_gap_ns = ns_per_s;

bool has_one_writer(const DroneTopic& topic) { return topic.of_all && !topic.newest_alone; }

}  // namespace

Status RosTopics::open_writers() {
  for (const DroneTopic& topic : drone_topics) {
    writers_.emplace_back();
    for (const std::string& drone : drones_) {
      if (has_one_writer(topic) && !writers_.back().empty()) continue;
      dds::Qos qos{.transient_local = topic.latched};
      if (topic.newest_alone) qos.depth = 1;
      auto writer = dds::RawWriter::create(participant_, topic_of(topic, drone), std::string(topic.type), qos);
      if (!writer) return writer.error();
      writers_.back().push_back(std::move(writer).value());
    }
  }
  return done;
}

void RosTopics::publish(const DroneUpdate& update) {
  const std::string& drone = drones_[update.drone];
  for (std::size_t i = 0; i < drone_topics.size(); ++i) {
    const DroneTopic& topic = drone_topics[i];
    const auto message = topic.make(update, drone);
    Status published = message ? done : Status(message.error());
    if (message && !message->empty())
      published = writers_[i][has_one_writer(topic) ? 0 : update.drone].publish(*message);
    if (published) continue;
    ++unpublished_[update.drone];
    if (monotonic_ns() < next_warning_ns_) continue;
    next_warning_ns_ = monotonic_ns() + warning_gap_ns;
    spdlog::warn("{}: {}", topic_of(topic, drone), published.error().message);
  }
}

Status RosTopics::read_pilots(const PilotSettings& settings, const OnMessage& on_message, const OnUnheard& on_unheard) {
  if (!settings.topics)
    spdlog::info("pilots' ROS 2 topics are not read: [pilot] topics = true reads them");
  else if (!settings.emergency)
    spdlog::info("/<drone>/emergency is not read without DDS Security: [pilot] emergency = true reads it");
  std::vector<dds::ReadTopic> read;
  const std::vector<const PilotTopic*> topics = topics_read(settings);
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    for (const PilotTopic& one : pilot_topics) {
      const PilotTopic* topic = &one;
      drone_of_topic_.push_back(i);
      read.push_back({topic_of(*topic, drones_[i]), std::string(topic->type), {.reliable = topic->reliable}});
      if (std::ranges::find(topics, topic) == topics.end()) {
        read.back().not_read =
            one.cuts ? "[pilot] topics = true and emergency = true read it" : "[pilot] topics = true reads it";
        continue;
      }
      auto reader =
          dds::RawReader::create(participant_, read.back().topic, read.back().type, read.back().qos,
                                 [i, topic, on_message](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
                                   on_message(i, *topic, dds::text_of(cdr));
                                 });
      if (!reader) return reader.error();
      readers_.push_back({i, std::move(reader).value()});
    }
  }
  auto discovery =
      dds::report_unheard(participant_, std::move(read), [this, on_unheard](std::size_t topic, const std::string& why) {
        {
          const std::lock_guard lock(unheard_mutex_);
          unheard_why_[topic] = why;
          if (why.empty()) unheard_why_.erase(topic);
        }
        if (!why.empty()) on_unheard(drone_of_topic_[topic], why);
      });
  if (!discovery) return discovery.error();
  discovery_ = std::move(discovery).value();
  return done;
}

std::vector<std::string> RosTopics::unheard() const {
  const std::lock_guard lock(unheard_mutex_);
  if (unheard_why_.empty()) return {};
  std::vector<std::string> why(drones_.size());
  for (const auto& [topic, words] : unheard_why_) {
    std::string& all = why[drone_of_topic_[topic]];
    all += (all.empty() ? "" : "; ") + words;
  }
  return why;
}

ShellCounters::Pilot RosTopics::losses(std::size_t drone) const {
  ShellCounters::Pilot losses;
  for (const Reader& one : readers_) {
    if (one.drone != drone) continue;
    losses.dds_lost += one.reader.lost();
    losses.dds_refused += one.reader.refused().total();
  }
  return losses;
}

}  // namespace ledgerline::ground
