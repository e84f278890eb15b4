#pragma once
#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/dds/raw.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/renewal/certificate_watch.hpp"
#include "common/program/recorder.hpp"
#include "common/rt/mailbox.hpp"
#include "ground/channel/channel.hpp"
#include "ground/core/flight_view.hpp"
#include "ground/core/topics.hpp"
#include "ground/service/core/board.hpp"
#include "ground/service/core/certificate_ends.hpp"
#include "ground/service/operators/leaving.hpp"
#include "ground/service/shell/fault_service.hpp"
#include "ground/service/shell/server.hpp"
#include "ground/shell/mission_service.hpp"
#include "ground/shell/operator_service.hpp"
#include "ground/shell/operators/role_watch.hpp"
#include "ground/shell/pilots/pilot_readers.hpp"
#include "ground/shell/settings.hpp"

namespace ledgerline::ground {

/// The shell around the FlightCore of each channel: blocks and outcomes come on the clients' threads, a pilot's
/// messages on DDS's; they are handed over and wake the one thread that runs the cores, submits their calls, publishes
/// the drones' topics, and writes trace and status lines.
class Ground {
 public:
  /// `channels`: at least one, that of [ledger] first. `channel_of`: for each drone, in the config's order.
  Ground(std::vector<Channel::Parts> channels, const std::vector<std::size_t>& channel_of, OutputSettings output,
         const PilotSettings& pilot, dds::ParticipantPtr participant);
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
  /// Has renewed certificates taken while it runs, and reports their ends on the station, with those of agents. Before
  /// serve().
  void watch_certificates(std::unique_ptr<fabric::CertificateWatch> watch) { certificates_ = std::move(watch); }
  /// Where the page is; empty: nowhere.
  std::string page_url() const { return server_ ? server_->url() : std::string(); }

 private:
  struct OfChannel {
    std::size_t channel;
    Channel::Update news;
  };
  /// What an operator's call came to.
  struct Report {
    service::Level level;
    std::string drone;
    std::string words;
  };
  /// An operator's session began, or is over.
  struct SessionChange {
    std::size_t who;
    bool in;
  };
  using Event = std::variant<OfChannel, Report, SessionChange>;

  std::vector<std::unique_ptr<Channel>> open_channels(std::vector<Channel::Parts> parts);
  Status open_topics();
  Status read_pilot_topics();
  /// What the page commands. Any thread. The error: it would only be flown later.
  Status take(const PilotCommand& one);
  /// What the page asks of missions. Any thread.
  void ask(service::MissionAsk asked, std::function<void(service::ApiAnswer)> answer);
  /// Changes what is commanded of a drone, and wakes the core's thread. Any thread.
  void post_command(std::size_t drone, const std::optional<crypto::IdentityName>& by,
                    const std::function<void(PilotCommand&)>& change);
  void post_command(const PilotCommand& one);
  /// As an event; `drone`: its name, empty: of none. Any thread.
  void say(service::Level level, const std::string& drone, std::string words);
  void open_missions(service::MissionSettings settings);
  Status open_service(const std::string& folder, const std::vector<fabric::ClientConfig>& ledgers);
  /// Ends the sessions of operators whose roles were taken.
  void dismiss(TimeNs now_ns);
  /// Lands what somebody holds who has left, gives it back, and forgets his key.
  void end_session(TimeNs now_ns);
  /// One of several.
  void lose(std::size_t channel, const Error& why);
  void show(TimeNs now_ns);
  void start_certificates();
  void tell_certificates(TimeNs now_ns);
  /// For the page: what a block holds.
  void note(const fabric::Block& block);
  void publish(std::size_t channel, const DroneUpdate& news);
  Status wait_for_block_streams(const std::atomic<bool>& quit);
  std::optional<Event> next_event(TimeNs timeout_ns);
  /// What of an event is for the cores, whose inputs these are; an error ends the flight.
  Status open(const Event& event, std::vector<FlightInputs>& inputs);
  Status open(std::size_t channel, const Channel::Update& news, FlightInputs& inputs);
  /// Of each channel, its drones as its core has them.
  std::vector<std::vector<PilotCommand>> split(const std::vector<PilotCommand>& commands) const;
  bool more_waits_for(std::size_t channel) const;
  std::vector<PilotCommand> take_commands();
  void step(std::vector<FlightInputs> inputs);
  void act(std::size_t channel, FlightOutputs& out);
  ShellCounters losses_of(std::size_t channel) const;
  void write_status(TimeNs now_ns);
  Status write_summary();

  OutputSettings output_;
  const PilotSettings pilot_;
  std::vector<std::unique_ptr<Channel>> channels_;  ///< closed before anything that they put into ends
  const FlightView view_;                           ///< of their cores
  const std::vector<std::string> names_;            ///< of the drones
  Recorder recorder_;
  dds::ParticipantPtr participant_;
  std::vector<std::vector<dds::RawWriter>> writers_;  ///< a row for each of drone_topics, a drone each
  TimeNs next_status_ns_ = 0, next_show_ns_ = 0;
  service::Board board_;
  std::vector<service::Event> unshown_;                ///< of this board, not handed to the server yet
  std::shared_ptr<const crypto::IdentityInUse> self_;  ///< of serve()
  service::CertificateEnds certificate_ends_;
  TimeNs next_certificates_ns_ = 0;
  service::Refusals refusals_;
  std::vector<service::BlockSummary> unshown_blocks_;  ///< as unshown_; at most max_reported_blocks
  TimeNs next_warning_ns_ = 0, next_unheard_log_ns_ = 0;

  Mailbox<Event> mailbox_;    ///< blocks in turn; of outcomes there are as many as calls in flight
  std::deque<Event> events_;  ///< taken out of the mailbox, not opened yet
  std::mutex commands_mutex_;
  std::vector<PilotCommand> commands_;           ///< at most one for each drone and operator
  std::atomic<bool> flying_{false};              ///< run() is
  std::vector<bool> lost_;                       ///< of each channel: what it says cannot be taken any more
  std::vector<std::uint64_t> news_unpublished_;  ///< likewise

  service::Leaving leaving_;  ///< operators of service_
  TimeNs session_idle_ns_ = 0;
  std::vector<std::size_t> dismissed_;  ///< as said last

  // Last, so that they end first: their callbacks use all of the above.
  std::unique_ptr<OperatorService> service_;       ///< null: nobody signs in
  std::vector<std::unique_ptr<RoleWatch>> roles_;  ///< of each channel, where operators sign in
  std::unique_ptr<MissionService> missions_;       ///< null: there is no service
  std::unique_ptr<service::FaultService> faults_;  ///< null: none are switched here
  std::unique_ptr<service::Server> server_;
  std::optional<PilotReaders> pilots_;
  std::unique_ptr<fabric::CertificateWatch> certificates_;
};

}  // namespace ledgerline::ground
