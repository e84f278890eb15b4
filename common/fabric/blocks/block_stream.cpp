#include <fmt/format.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/base/text.hpp"
#include "common/fabric/blocks/block_hand_over.hpp"
#include "common/fabric/client/connection.hpp"
#include "common/fabric/client/stream_thread.hpp"
#include "orderer/ab.grpc.pb.h"
#include "peer/events.grpc.pb.h"
#include "peer/events.pb.h"
#include "peer/lifecycle/lifecycle.pb.h"
#include "peer/peer.grpc.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr int max_lags = 8;  // some seconds of back-off
// Each question has the client's own deadline, and the stream waits for the answer: twice as many delay a start by
// twice as long, one alone makes an endorser end at a single late answer.
constexpr int max_questions = 4;
constexpr TimeNs first_question_pause_ns = 50 * ns_per_ms, max_question_pause_ns = 400 * ns_per_ms;

/// While it lives, every block that is committed comes through here.
class Seeing {
 public:
  explicit Seeing(Commits& commits) : commits_(commits) { commits_.connected(true); }
  ~Seeing() { commits_.connected(false); }
  Seeing(const Seeing&) = delete;
  Seeing& operator=(const Seeing&) = delete;

 private:
  Commits& commits_;
};

BlockIntake::Fetch fetcher(const Connection& connection, StreamThread& thread) {
  return [&](std::uint64_t number) { return fetch_block(connection, thread, number); };
}

/// What a server answered in place of blocks, and what may be wrong with the config.
Error refusal(const ClientConfig& config, const std::string& endpoint, common::Status status) {
  std::string cure;
  if (status == common::FORBIDDEN)
    cure = fmt::format(": are msp_id {} and the identity's files of one organisation of channel {}?",
                       config.identity.name.msp_id, config.where.channel);
  if (status == common::NOT_FOUND) cure = fmt::format(": has it joined channel {}?", config.where.channel);
  return Error{fmt::format("{} refused the stream: {}{}", endpoint, common::Status_Name(status), cure)};
}

/// Reads the own peer's blocks, one connection a call of follow(). One thread.
class BlockReader {
 public:
  BlockReader(std::shared_ptr<const Connection> connection, std::optional<LastVerified> verified,
              std::shared_ptr<BlockHandOver> blocks, std::function<void(const Continuation&)> on_continued)
      : connection_(std::move(connection)),
        verified_(std::move(verified)),
        blocks_(std::move(blocks)),
        on_continued_(std::move(on_continued)) {}

  /// Ends the connection to an orderer that lies or withholds blocks; before the first follow().
  void interrupt_ordered_by(std::function<void()> interrupt) { interrupt_ordered_ = std::move(interrupt); }
  std::string follow(StreamThread& thread);

 private:
  Status continue_chain(StreamThread& thread);
  void query_definition(StreamThread& thread);
  struct DefinitionAnswer {
    Result<std::string> policy;  ///< the definition's validation_parameter
    bool may_pass = false;       ///< there is none, but another question may be answered
  };
  DefinitionAnswer definition_of_peer(StreamThread& thread) const;
  Status hand_over(const protos::DeliverResponse& response, const std::string& endpoint, StreamThread& thread);

  const std::shared_ptr<const Connection> connection_;
  std::optional<LastVerified> verified_;  ///< until the chain goes on behind it
  const std::shared_ptr<BlockHandOver> blocks_;
  const std::function<void(const Continuation&)> on_continued_;
  std::function<void()> interrupt_ordered_;
  int lagged_ = 0;  ///< connections in a row in which the peer's chain ended before the checkpoint
  bool definition_problem_reported_ = false;
};

/// Reads an orderer's blocks; the next orderer's when one goes away or delivers invalid blocks. One thread.
class OrderedReader {
 public:
  OrderedReader(std::shared_ptr<const Connection> connection, std::shared_ptr<BlockHandOver> blocks)
      : connection_(std::move(connection)), blocks_(std::move(blocks)) {}

  std::string follow(StreamThread& thread);

 private:
  const std::shared_ptr<const Connection> connection_;
  const std::shared_ptr<BlockHandOver> blocks_;
  std::size_t which_ = 0;
};

std::string BlockReader::follow(StreamThread& thread) {
  if (const Status continued = continue_chain(thread); !continued) return continued.error().message;
  query_definition(thread);
  grpc::ClientContext context;
  const StreamThread::Cancellable cancellable(thread, context);
  const std::size_t peer = connection_->peer();
  const auto channels = connection_->channels();
  const auto stub = protos::Deliver::NewStub(channels->stream_peers[peer]);
  const auto stream = stub->Deliver(&context);
  const auto start = blocks_->locked([](const BlockIntake& intake) { return intake.next_of_peer(); });
  const std::string& endpoint = connection_->endpoint(peer);
  if (const Status sent = seek(*connection_, *stream, endpoint, channels->peer_tls_hashes[peer], start); !sent)
    return sent.error().message;
  std::optional<Seeing> seeing;
  if (start && blocks_->consistent()) {
    seeing.emplace(*connection_->commits);
    thread.connected();
  }
  bool first = true;
  protos::DeliverResponse response;
  return read_all(thread, context, *stream, endpoint, response, [&](const protos::DeliverResponse& message) -> Status {
    if (std::exchange(first, false)) blocks_->peer_connected();
    if (const Status handed_over = hand_over(message, endpoint, thread); !handed_over) return handed_over;
    const Status consistent = blocks_->consistent();
    if (!consistent) {
      // An orderer's block showed it: this connection is lost by it. The next is read on for stops alone, and is no
      // connection to the ledger.
      return seeing ? consistent : Status(done);
    }
    if (!seeing) seeing.emplace(*connection_->commits);
    thread.connected();
    thread.progress();
    return done;
  });
}

/// Finds the place behind the checkpoint, where there is one; once.
Status BlockReader::continue_chain(StreamThread& thread) {
  if (!verified_) return done;
  const auto newest = fetch_block(*connection_, thread, std::nullopt);
  if (!newest) return newest.error();
  const BlockIntake::Fetch fetch = fetcher(*connection_, thread);
  bool fetch_failed = false;
  const auto on = blocks_->locked(
      [&](BlockIntake& intake) { return intake.continue_chain(*verified_, *newest, watched(fetch, fetch_failed)); });
  if (!on) {
    // A peer that lags behind may be honest, for a moment.
    const bool lags = newest->header().number() < verified_->last.number;
    lagged_ = lags ? lagged_ + 1 : 0;
    if ((!lags || lagged_ >= max_lags) && !fetch_failed) blocks_->contradicted(on.error().message);
    return on.error();
  }
  verified_.reset();
  if (on_continued_) on_continued_(*on);
  return done;
}

/// Whose endorsement the contract needs lies behind the first block that is read: the peer is asked. What it says may
/// confirm a transaction, not refuse one. A peer that is busy or has just started may be late: it is asked again a few
/// times, since an endorser ends without the answer. After these tries have failed, each further connection asks once.
void BlockReader::query_definition(StreamThread& thread) {
  if (!blocks_->locked([](const BlockIntake& intake) { return intake.misses_definition(); })) return;
  BackOff back_off(first_question_pause_ns, max_question_pause_ns);
  Random random(random_seed());
  const int tries = definition_problem_reported_ ? 1 : max_questions;
  DefinitionAnswer answer{Error{""}};
  int tried = 0;
  do {
    if (tried > 0 && !thread.pause(back_off.next(random))) return;
    answer = definition_of_peer(thread);
    ++tried;
    if (answer.policy) return blocks_->locked([&](BlockIntake& intake) { intake.define(*answer.policy); });
  } while (answer.may_pass && tried < tries && !thread.stopping());
  if (thread.stopping() || std::exchange(definition_problem_reported_, true)) return;
  blocks_->report_unverified(fmt::format(
      "the peer does not say whose endorsement contract {} needs, asked {} ({}): of what makes new keys the flags are "
      "trusted",
      connection_->config.where.contract, tried == 1 ? "once" : fmt::format("{} times", tried),
      printable(answer.policy.error().message)));
}

BlockReader::DefinitionAnswer BlockReader::definition_of_peer(StreamThread& thread) const {
  lifecycle::QueryChaincodeDefinitionArgs question;
  question.set_name(connection_->config.where.contract);
  const auto proposal = make_proposal(*connection_->signing(), {connection_->config.where.channel, "_lifecycle"},
                                      {"QueryChaincodeDefinition", {question.SerializeAsString()}}, realtime_ns(),
                                      crypto::random_bytes(24));
  if (!proposal) return {proposal.error()};
  protos::SignedProposal message;
  if (!message.ParseFromString(proposal->signed_proposal)) return {Error{"the question is malformed"}};
  grpc::ClientContext context;
  const StreamThread::Cancellable cancellable(thread, context);
  context.set_deadline(std::chrono::system_clock::now() + connection_->config.deadline);
  const std::size_t peer = connection_->peer();
  const auto stub = protos::Endorser::NewStub(connection_->channels()->stream_peers[peer]);
  protos::ProposalResponse answer;
  const grpc::Status status = stub->ProcessProposal(&context, message, &answer);
  if (!status.ok())
    return {.policy = Error{text_of(status, connection_->endpoint(peer))},
            .may_pass = may_pass(status) || status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED};
  if (answer.response().status() != 200) return {Error{answer.response().message()}};
  lifecycle::QueryChaincodeDefinitionResult definition;
  if (!definition.ParseFromString(answer.response().payload())) return {Error{"its answer is malformed"}};
  return {definition.validation_parameter()};
}

Status BlockReader::hand_over(const protos::DeliverResponse& response, const std::string& endpoint,
                              StreamThread& thread) {
  if (response.Type_case() == protos::DeliverResponse::kStatus)
    return refusal(connection_->config, endpoint, response.status());
  if (response.Type_case() != protos::DeliverResponse::kBlock) return Error{"the peer sent something else than blocks"};
  const auto orderer = blocks_->on_peer_block(response.block(), monotonic_ns(), fetcher(*connection_, thread));
  if (!orderer) return orderer.error();
  if (*orderer == BlockHandOver::OrdererStream::ends && interrupt_ordered_) interrupt_ordered_();
  return done;
}

std::string OrderedReader::follow(StreamThread& thread) {
  const auto start = blocks_->begin_ordered();
  if (!start) return {};  // the peer's stream comes first
  grpc::ClientContext context;
  const StreamThread::Cancellable cancellable(thread, context);
  const auto channels = connection_->channels();
  const std::size_t at = which_++ % channels->stream_orderers.size();
  const auto stub = orderer::AtomicBroadcast::NewStub(channels->stream_orderers[at]);
  const auto stream = stub->Deliver(&context);
  const std::string& endpoint = connection_->config.orderers[at].endpoint;
  if (const Status sent = seek(*connection_, *stream, endpoint, channels->orderer_tls_hashes[at], start); !sent)
    return sent.error().message;
  bool ended_here = false;
  orderer::DeliverResponse response;
  const std::string why =
      read_all(thread, context, *stream, endpoint, response, [&](orderer::DeliverResponse& message) -> Status {
        const Status handed_over = message.has_block()
                                       ? blocks_->on_ordered_block(std::move(*message.mutable_block()), monotonic_ns())
                                       : refusal(connection_->config, endpoint, message.status());
        ended_here = !handed_over || thread.stopping();
        if (ended_here || !blocks_->consistent()) return handed_over;
        thread.connected();
        thread.progress();
        return done;
      });
  return ended_here ? why : blocks_->withheld().value_or(why);
}

BlockIntake make_intake(const Connection& connection, std::optional<std::uint64_t> start) {
  const ClientConfig& config = connection.config;
  BlockIntake intake = std::move(BlockIntake::make({.where = config.where,
                                                    .config_block = config.config_block,
                                                    .make_registry = BlockValidator::registry_of(config.verifier),
                                                    .contract_rules = config.contract_rules,
                                                    .real_time = realtime_ns,
                                                    .source = config.blocks}))
                           .value();  // make_connection has tried it
  if (start) intake.start_at(*start);
  return intake;
}

/// The own peer's stream and, where it is read, an orderer's; both run until this is gone.
class BlockStreams final : public Client::Stream {
 public:
  BlockStreams(const std::shared_ptr<const Connection>& connection, std::optional<std::uint64_t> start,
               std::optional<LastVerified> verified, Client::StreamHandlers handlers) {
    auto on_connection = handlers.on_connection;
    auto on_orderers = handlers.on_orderers;
    auto on_continued = handlers.on_continued;
    const auto blocks =
        std::make_shared<BlockHandOver>(make_intake(*connection, start), connection->commits, std::move(handlers));
    const auto reader = std::make_shared<BlockReader>(connection, std::move(verified), blocks, std::move(on_continued));
    if (!connection->channels()->stream_orderers.empty()) {
      ordered_ = run_reader(std::make_shared<OrderedReader>(connection, blocks), std::move(on_orderers));
      reader->interrupt_ordered_by([this] { ordered_->interrupt(); });
    }
    peers_ = run_reader(reader, std::move(on_connection));
  }
  ~BlockStreams() override {
    // One may wait for the other, which waits for a peer.
    peers_->stop();
    if (ordered_) ordered_->stop();
  }
  BlockStreams(const BlockStreams&) = delete;
  BlockStreams& operator=(const BlockStreams&) = delete;

 private:
  std::unique_ptr<StreamThread> ordered_;
  std::unique_ptr<StreamThread> peers_;  ///< ends first: it interrupts the other
};

}  // namespace

std::unique_ptr<Client::Stream> open_block_stream(const std::shared_ptr<const Connection>& connection,
                                                  std::optional<std::uint64_t> start,
                                                  std::optional<LastVerified> verified,
                                                  Client::StreamHandlers handlers) {
  return std::make_unique<BlockStreams>(connection, start, std::move(verified), std::move(handlers));
}

}  // namespace ledgerline::fabric
