#pragma once
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "ground/core/flight_view.hpp"
#include "ground/service/core/board.hpp"
#include "ground/service/core/drone_queries.hpp"
#include "ground/service/shell/fault_service.hpp"
#include "ground/service/shell/server.hpp"

namespace ledgerline::ground {

/// The page and the API: what happens to the flight is gathered here, and goes to the server's clients as often as
/// somebody looks. The flight's thread.
class Station {
 public:
  /// `self`: whose transactions are ground's own.
  Station(const FlightView& view, std::vector<std::string> drones, std::shared_ptr<const crypto::IdentityInUse> self)
      : view_(view), names_(std::move(drones)), self_(std::move(self)), refusals_(names_) {}
  ~Station() { close(); }

  /// Opens the server; `report_fault`: on the thread that switches faults.
  Status open(const service::ServiceSettings& settings, const service::Greeting& greeting,
              service::Server::Handlers handlers, service::FaultService::Report report_fault);
  /// No fault is switched any more; the server stays until the end.
  void close();
  std::string url() const { return server_->url(); }

  void add_event(Level level, const std::string& drone, std::string words);
  /// Who asked for what: "land, asked for by alice". In the log, too.
  void add_request(const std::string& drone, const std::string& words) { requests_.add(drone, words, words); }
  /// How a call of the contract's `function` ended.
  void add_outcome(std::string_view function, const fabric::Outcome& outcome) { refusals_.add(function, outcome); }
  /// Soon, where the block may have changed a record of control: it decides what the next order is answered.
  void show_changes_of(const fabric::Block& block);
  void add_block(const fabric::Block& block);
  void publish_missions(std::string list) { server_->publish_missions(std::move(list)); }
  /// These operators may sign nothing any more.
  void dismiss(const std::vector<std::size_t>& who) { server_->dismiss(who); }
  /// Behind the cores' step, whose notes these are.
  void update(const std::vector<std::string>& notes);
  /// What is new, where it is due.
  void show(TimeNs now_ns);
  /// The last of it.
  void end();

 private:
  const FlightView& view_;
  const std::vector<std::string> names_;
  const std::shared_ptr<const crypto::IdentityInUse> self_;
  service::Board board_;
  service::Refusals refusals_;
  service::Notices<std::string> requests_;             ///< by their words
  std::vector<service::Event> unshown_;                ///< of the board, not handed to the server yet
  std::vector<service::BlockSummary> unshown_blocks_;  ///< likewise; at most max_reported_blocks
  TimeNs next_show_ns_ = 0, shown_ns_ = 0;
  std::unique_ptr<service::FaultService> faults_;  ///< null: none are switched here
  std::unique_ptr<service::Server> server_;
};

}  // namespace ledgerline::ground
