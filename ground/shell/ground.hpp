#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/tls/certificate_watch.hpp"
#include "common/program/program.hpp"
#include "ground/core/flight_view.hpp"
#include "ground/shell/channel.hpp"
#include "ground/shell/inbox.hpp"
#include "ground/shell/mission_service.hpp"
#include "ground/shell/operators.hpp"
#include "ground/shell/ros_topics.hpp"
#include "ground/shell/settings.hpp"
#include "ground/shell/station.hpp"

namespace ledgerline::ground {

/// The shell around the FlightCore of each channel: blocks and outcomes come on the clients' threads, a pilot's
/// messages on DDS's; they are handed over and wake the one thread that runs the cores, submits their calls, publishes
/// the drones' topics, and writes trace and status lines.
class Ground {
 public:
  /// `channels`: at least one, that of [ledger] first. `channel_of`: for each drone, in the config's order. `watch`:
  /// has renewed certificates taken while it runs.
  Ground(std::vector<Channel::Parts> channels, const std::vector<std::size_t>& channel_of, OutputSettings output,
         const PilotSettings& pilot, dds::ParticipantPtr participant, std::unique_ptr<fabric::CertificateWatch> watch);
  ~Ground();

  /// Opens trace and topics, subscribes to blocks, reads the drones' control records. Ends early, with an error, when
  /// `quit`.
  Status start(const std::atomic<bool>& quit);
  /// Flies until every drone has landed or failed. Once `quit` is set, all drones land, and it returns at the latest
  /// `landing_limit` later. True when every drone finished its path and landed.
  Result<bool> run(const std::atomic<bool>& quit);
  /// The page and the API, from the start on. Before start(). `ledgers`: of each channel, as of the clients above, for
  /// the operators'.
  Status serve(const service::ServiceSettings& settings, service::MissionSettings missions,
               const std::vector<fabric::ClientConfig>& ledgers);
  /// Where the page is; empty: nowhere.
  std::string page_url() const { return station_ ? station_->url() : std::string(); }

 private:
  std::vector<std::unique_ptr<Channel>> open_channels(std::vector<Channel::Parts> parts);
  /// What the page commands. Any thread. The error: it would only be flown later.
  Status command(const PilotCommand& one);
  /// What the page asks of missions. Any thread.
  void request_mission(service::MissionRequest asked, std::function<void(service::ApiAnswer)> answer);
  /// As an event; `drone`: its name, empty: of none. Any thread.
  void post_event(service::Level level, const std::string& drone, std::string words);
  void open_missions(service::MissionSettings settings);
  Status open_operators(const service::ServiceSettings& settings, const std::vector<fabric::ClientConfig>& ledgers);
  /// One of several.
  void fail_channel(std::size_t channel, const Error& why);
  Status wait_for_block_streams(const std::atomic<bool>& quit);
  /// Puts a channel's update into its core's inputs; other events go to the page or the operators' sessions. An error
  /// ends the flight.
  Status dispatch(const Inbox::Event& event, std::vector<FlightInputs>& inputs);
  Status dispatch(std::size_t channel, const Channel::Update& update, FlightInputs& inputs);
  void report_requests(const std::vector<PilotCommand>& commands);
  /// Of each channel, its drones as its core has them.
  std::vector<std::vector<PilotCommand>> split(const std::vector<PilotCommand>& commands) const;
  void step(std::vector<FlightInputs> inputs);
  void act(std::size_t channel, FlightOutputs& out);
  ShellCounters losses_of(std::size_t channel) const;
  /// Of agents' certificates, once a second: ends are reported by the day.
  void report_certificate_ends(TimeNs now_ns);
  void write_status(TimeNs now_ns);
  Status write_summary();

  OutputSettings output_;
  const PilotSettings pilot_;
  Inbox inbox_;
  std::vector<std::unique_ptr<Channel>> channels_;
  const FlightView view_;                 ///< of their cores
  const std::vector<std::string> names_;  ///< of the drones
  Recorder recorder_;
  RosTopics topics_;
  service::Board board_;  ///< where there is no page: its alarms are in the log all the same
  TimeNs next_status_ns_ = 0, next_unheard_log_ns_ = 0;
  service::CertificateEnds ends_;
  TimeNs next_ends_ns_ = 0;
  std::atomic<bool> flying_{false};  ///< run() is
  std::vector<bool> lost_;           ///< of each channel: what it says cannot be taken any more

  // Last, so that they end first, each before those above that it calls.
  std::unique_ptr<OperatorSessions> operators_;  ///< null: nobody signs in
  std::unique_ptr<MissionService> missions_;     ///< null: there is no page
  std::unique_ptr<Station> station_;             ///< null: there is no page
  std::unique_ptr<fabric::CertificateWatch> watch_;
};

}  // namespace ledgerline::ground
