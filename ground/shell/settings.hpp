#pragma once
#include <string>
#include <vector>

#include "common/bridge/core/rules.hpp"
#include "common/config/config.hpp"
#include "common/rt/histogram.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/core/flight_view.hpp"
#include "ground/service/core/guard.hpp"
#include "ground/service/missions/book.hpp"

namespace ledgerline::ground {

struct OutputSettings {
  std::string trace;            ///< file; empty: none
  std::string summary;          ///< file; empty: none
  TimeNs status_period_ns = 0;  ///< JSON lines on standard output; 0: none
};

/// Reads [flight] and [[drone]]; what is wrong comes with config.finish().
FlightConfig flight_config(Config& config);
/// That flight with those of its drones that are on one channel. `channel_of`: of each drone.
FlightConfig flight_of_channel(const FlightConfig& flight, const std::vector<std::size_t>& channel_of,
                               std::size_t channel);
/// Reads what else ground bridges: not the drones' topics and pilots'.
bridge::BridgeConfig read_bridge(Config& config, const std::vector<FlightDrone>& drones);
/// Reads [output], but for its checkpoint.
OutputSettings output_settings(Config& config);
/// Reads [service].
service::ServiceSettings service_settings(Config& config);
/// Reads [mission].
service::MissionSettings mission_settings(Config& config);
/// Reads [output] checkpoint, of who follows a ledger: the file of the newest block verified; empty: none.
std::string checkpoint_path(Config& config);

/// What pilots may say by DDS, which knows no users.
struct PilotSettings {
  bool topics = true;      ///< the five topics are read, but for the next
  bool emergency = false;  ///< that one, too: motors off
};
/// Reads [pilot]. Where operators sign in the topics are a way past them, so they have to be asked for; motors off has
/// to be asked for wherever DDS does not know whom it hears.
PilotSettings pilot_settings(Config& config, bool has_operators, bool has_dds_security);
/// Those of `pilot_topics` that are read.
std::vector<const PilotTopic*> topics_read(const PilotSettings& settings);

/// What the shell counts itself.
struct ShellCounters {
  struct Pilot {
    std::uint64_t dds_lost = 0, dds_refused = 0;  ///< messages that DDS did not hand over
  };
  std::vector<Pilot> pilots;           ///< of each drone
  Quantiles confirmed_after_ms{};      ///< of blocks taken as they were ordered
  std::uint64_t news_unpublished = 0;  ///< what the ledger had was no such message, or DDS did not take it
};

/// The status line and the summary, as JSON text.
/// `certificate_days`: until the first of its certificates ends.
std::string status_line(const FlightView& flights, std::optional<std::int64_t> certificate_days = {});
std::string summary(const FlightCore& core, const ShellCounters& shell);
/// Of several channels: {"channels": [...]}, each as its own says it.
std::string summary_of_all(const std::vector<std::string>& channels);

}  // namespace ledgerline::ground
