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

#include "common/belief/control_records.hpp"
#include "common/dds/dds.hpp"
#include "common/dds/raw.hpp"
#include "common/fabric/checkpoint/kept_blocks.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/renewal/certificate_watch.hpp"
#include "common/fabric/stream/confirmations.hpp"
#include "common/program/recorder.hpp"
#include "common/rt/mailbox.hpp"
#include "ground/core/topics.hpp"
#include "ground/service/core/board.hpp"
#include "ground/service/core/certificate_ends.hpp"
#include "ground/service/operators/leaving.hpp"
#include "ground/service/shell/fault_desk.hpp"
#include "ground/service/shell/server.hpp"
#include "ground/shell/mission_desk.hpp"
#include "ground/shell/operator_desk.hpp"
#include "ground/shell/settings.hpp"

namespace ledgerline::ground {

/// The shell around FlightCore: blocks and outcomes come on the client's threads, a pilot's messages on DDS's; they are
/// handed over and wake the one thread that runs the core, submits its calls, publishes the drones' topics, and writes
/// trace and status lines.
class Ground {
 public:
  /// `client` is for commands and blocks, `urgent` for what must not wait behind commands. `kept`: as the last ground
  /// left it.
  Ground(FlightConfig flight, OutputSettings output, dds::ParticipantPtr participant,
         std::unique_ptr<fabric::Client> client, std::unique_ptr<fabric::Client> urgent, fabric::KeptCheckpoint kept);
  ~Ground();

  /// Opens trace and topics, subscribes to blocks, reads the drones' control records. Ends early, with an error, when
  /// `quit`.
  Status start(const std::atomic<bool>& quit);
  /// Flies until every drone has landed or failed. Once `quit` is set, all drones land, and it returns at the latest
  /// `landing_limit` later. True when every drone finished its path and landed.
  Result<bool> run(const std::atomic<bool>& quit);
  /// The page and the API, from the start on. Before start(). `ledger`: as of the clients above, for the operators'.
  Status serve(const service::ServiceSettings& settings, service::MissionSettings missions,
               const fabric::ClientConfig& ledger);
  /// Has renewed certificates taken while it runs, and tells their ends on the station, with those of agents. Before serve().
  void watch_certificates(std::unique_ptr<fabric::CertificateWatch> watch) { certificates_ = std::move(watch); }
  /// Where the page is; empty: nowhere.
  std::string page_url() const { return server_ ? server_->url() : std::string(); }

 private:
  struct Ended {
    std::uint64_t id;
    std::string function;  ///< that was called
    fabric::Outcome outcome;
  };
  struct StreamState {
    bool connected = false;
    std::string why;
  };
  /// The control records, as read after the first block had come, or why they cannot be.
  struct ControlsRead {
    Result<std::vector<Control>> controls;
  };
  /// What an operator's call came to.
  struct Told {
    service::Level level;
    std::string drone;
    std::string words;
  };
  /// An operator's session began, or is over.
  struct SessionChange {
    std::size_t who;
    bool in;
  };
  using Letter = std::variant<fabric::Block, Ended, StreamState, ControlsRead, Told, SessionChange>;

  Status open_topics();
  Status hear_pilots();
  void hear(std::size_t drone, const PilotTopic& topic, std::string_view cdr);
  /// What the page wishes. Any thread. The error: it would only be flown later.
  Status take(const PilotWish& one);
  /// What the page asks of missions. Any thread.
  void ask(service::MissionAsk asked, std::function<void(service::ApiAnswer)> answer);
  /// Changes what is wished of a drone, and wakes the core's thread. Any thread.
  void wish(std::size_t drone, const std::optional<crypto::IdentityName>& by,
            const std::function<void(PilotWish&)>& change);
  void wish(const PilotWish& one);
  /// As an event; `drone`: its name, empty: of none. Any thread.
  void say(service::Level level, const std::string& drone, std::string words);
  void open_missions(service::MissionSettings settings);
  Status open_desk(const std::string& folder, const fabric::ClientConfig& ledger);
  /// Lands what somebody holds who has left, gives it back, and forgets his key.
  void see_off(TimeNs now_ns);
  void show(TimeNs now_ns);
  void start_certificates();
  void tell_certificates(TimeNs now_ns);
  /// For whoever looks at the page: what a block holds.
  void note(const fabric::Block& block);
  void publish(const DroneNews& news);
  Status wait_for_block_stream(const std::atomic<bool>& quit);
  Status set_controls(const std::vector<Control>& controls);
  std::optional<Letter> next_letter(TimeNs timeout_ns);
  /// What of a letter is for the core; an error ends the flight.
  Status open(const Letter& letter, FlightInputs& inputs);
  std::vector<PilotWish> take_wishes();
  void step(FlightInputs inputs);
  void count_losses();
  void write_status(TimeNs now_ns);
  Status write_summary();

  OutputSettings output_;
  FlightCore core_;
  const std::vector<std::string> names_;  ///< of the drones
  Recorder recorder_;
  dds::ParticipantPtr participant_;
  std::vector<std::vector<dds::RawWriter>> writers_;  ///< a row for each of drone_topics, a drone each
  ShellCounters counters_;
  TimeNs next_status_ns_ = 0, next_show_ns_ = 0;
  service::Board board_;
  std::vector<service::Event> unshown_;                ///< of this board, not handed to the server yet
  std::shared_ptr<const crypto::IdentityInUse> self_;  ///< of serve()
  service::CertificateEnds certificate_ends_;
  TimeNs next_certificates_ns_ = 0;
  service::Refusals refusals_;
  std::vector<service::BlockSummary> unshown_blocks_;  ///< as unshown_; at most max_told_blocks
  TimeNs next_warning_ns_ = 0, next_unheard_log_ns_ = 0;

  Mailbox<Letter> mailbox_;     ///< blocks in turn; of outcomes there are as many as calls in flight
  std::deque<Letter> letters_;  ///< taken out of the mailbox, not opened yet
  std::mutex wishes_mutex_;
  std::vector<PilotWish> wishes_;    ///< at most one for each drone and operator
  std::atomic<bool> flying_{false};  ///< run() is
  StreamState stream_;
  belief::ControlStart control_start_;
  fabric::KeptCheckpoint kept_;  ///< until start()

  service::Leaving leaving_;  ///< operators of desk_
  TimeNs session_idle_ns_ = 0;

  // Last, so that they end first: their callbacks use all of the above.
  std::unique_ptr<OperatorDesk> desk_;          ///< null: nobody signs in
  std::unique_ptr<MissionDesk> missions_;       ///< null: there is no service
  std::unique_ptr<service::FaultDesk> faults_;  ///< null: none are switched here
  std::unique_ptr<service::Server> server_;
  std::vector<dds::RawReader> readers_;  ///< of each drone one for each of pilot_topics
  std::unique_ptr<fabric::Client> client_, urgent_;
  fabric::Confirmations confirmations_;
  std::unique_ptr<fabric::Client::Stream> blocks_;
  std::jthread control_reader_;
  std::unique_ptr<fabric::CertificateWatch> certificates_;
};

}  // namespace ledgerline::ground
