#include "ground/shell/pilots/pilot_readers.hpp"

namespace ledgerline::ground {

Result<PilotReaders> PilotReaders::create(const dds::ParticipantPtr& participant,
                                          const std::vector<std::string>& drones, const PilotSettings& settings,
                                          const OnMessage& on_message) {
  PilotReaders pilots;
  for (std::size_t i = 0; i < drones.size(); ++i) {
    for (const PilotTopic* topic : topics_read(settings)) {
      auto reader = dds::RawReader::create(
          participant, topic_of(*topic, drones[i]), std::string(topic->type), {.reliable = topic->reliable},
          [i, topic, on_message](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
            on_message(i, *topic, dds::text_of(cdr));
          });
      if (!reader) return reader.error();
      pilots.readers_.push_back({i, std::move(reader).value()});
    }
  }
  return pilots;
}

ShellCounters::Pilot PilotReaders::losses(std::size_t drone) const {
  ShellCounters::Pilot losses;
  for (const OfDrone& one : readers_) {
    if (one.drone != drone) continue;
    losses.dds_lost += one.reader.lost();
    losses.dds_refused += one.reader.refused().total();
  }
  return losses;
}

}  // namespace ledgerline::ground
