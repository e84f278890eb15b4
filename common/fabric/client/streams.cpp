#include "common/fabric/client/streams.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/printable.hpp"
#include "common/fabric/stream/block_intake.hpp"
#include "common/fabric/tx/cross_check.hpp"
#include "gateway/gateway.grpc.pb.h"
#include "orderer/ab.grpc.pb.h"
#include "peer/events.grpc.pb.h"
#include "peer/lifecycle/lifecycle.pb.h"
#include "peer/peer.grpc.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr TimeNs first_reconnect_ns = 20 * ns_per_ms, max_reconnect_ns = 1 * ns_per_s;
constexpr int max_lags = 8;                               // some seconds of back-off
constexpr TimeNs unbelievable_period_ns = 60 * ns_per_s;  // a peer may send thousands; a log must not fill a disk

std::string text_of(const grpc::Status& status) {
  return status.ok() ? "the ledger ended the stream"
                     : fmt::format("{} (gRPC {})", describe(status), static_cast<int>(status.error_code()));
}

/// Asks for blocks from `start` on; an empty text when the question is on its way.
template <typename DeliverStream>
std::string seek(const Connection& connection, DeliverStream& stream, std::optional<std::uint64_t> start,
                 SeekStop stop = SeekStop::never) {
  auto envelope = make_seek(connection.config.identity, connection.config.where.channel, start, realtime_ns(),
                            crypto::random_bytes(24), stop);
  if (!envelope) return envelope.error().what;
  common::Envelope message;
  message.ParseFromString(*envelope);
  return stream.Write(message) ? "" : text_of(stream.Finish());
}

/// One block of the peer that is asked now, while another stream waits; without a number its newest.
Result<common::Block> fetch_block(const Connection& connection, Follower& follower,
                                  std::optional<std::uint64_t> number) {
  grpc::ClientContext context;
  const Follower::Cancellable cancellable(follower, context);
  context.set_deadline(std::chrono::system_clock::now() + connection.config.deadline);
  const auto stub = protos::Deliver::NewStub(connection.stream_peers[connection.peer()]);
  const auto stream = stub->Deliver(&context);
  if (std::string problem = seek(connection, *stream, number, SeekStop::at_start); !problem.empty())
    return Error{problem};
  protos::DeliverResponse response;
  const bool read = stream->Read(&response);
  context.TryCancel();
  const grpc::Status status = stream->Finish();
  if (!read || response.Type_case() != protos::DeliverResponse::kBlock ||
      (number && response.block().header().number() != *number))
    return Error{fmt::format("the peer does not give {}: {}",
                             number ? fmt::format("block {}", *number) : "its newest block", text_of(status))};
  return std::move(*response.mutable_block());
}

BlockIntake make_intake(const ClientConfig& config, const std::shared_ptr<CrossCheck>& cross_check) {
  BlockIntake::Setup setup{.where = config.where,
                           .config_block = config.config_block,
                           .make_registry = BlockJudge::registry_of(config.verifier),
                           .likely_policy = config.likely_policy};
  if (cross_check) {
    setup.compare = [cross_check](std::uint64_t number, const std::string& hash) {
      return cross_check->add(CrossCheck::Source::peer, number, hash);
    };
  }
  return std::move(BlockIntake::make(std::move(setup))).value();  // make_connection has tried it
}

class BlockReader {
 public:
  BlockReader(std::shared_ptr<const Connection> connection, BlocksFrom from, Client::StreamHandlers handlers,
              const std::shared_ptr<CrossCheck>& cross_check)
      : connection_(std::move(connection)),
        believed_(std::move(from.believed)),
        handlers_(std::move(handlers)),
        intake_(make_intake(connection_->config, cross_check)) {
    if (from.number) intake_.start_at(*from.number);
  }

  std::string follow(Follower& follower) {
    if (std::string problem = continue_chain(follower); !problem.empty()) return problem;
    ask_definition(follower);
    grpc::ClientContext context;
    const Follower::Cancellable cancellable(follower, context);
    const auto stub = protos::Deliver::NewStub(connection_->stream_peers[connection_->peer()]);
    const auto stream = stub->Deliver(&context);
    if (std::string problem = seek(*connection_, *stream, intake_.next()); !problem.empty()) return problem;
    intake_.begin();
    std::optional<Seeing> seeing;
    if (intake_.next()) {
      seeing.emplace(*connection_->commits);
      follower.connected();
    }
    protos::DeliverResponse response;
    while (stream->Read(&response)) {
      std::string problem = take(response, follower);
      if (!problem.empty() || follower.stopping()) {
        context.TryCancel();
        (void)stream->Finish();
        return problem;
      }
      if (!seeing) seeing.emplace(*connection_->commits);
      follower.connected();
      follower.progress();
    }
    return text_of(stream->Finish());
  }

 private:
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

  /// Finds the place behind the checkpoint, where there is one; once.
  std::string continue_chain(Follower& follower) {
    if (!believed_) return {};
    const auto newest = fetch(follower, std::nullopt);
    if (!newest) return newest.error().what;
    failed_fetch_ = false;
    const auto on = intake_.continue_chain(*believed_, *newest, fetcher(follower));
    if (!on) {
      // A peer that lags behind may be honest, for a moment.
      const bool lags = newest->header().number() < believed_->last.number;
      lagged_ = lags ? lagged_ + 1 : 0;
      return lags && lagged_ < max_lags ? on.error().what : contradicted(on.error().what);
    }
    believed_.reset();
    if (handlers_.on_continued) handlers_.on_continued(*on);
    return {};
  }

  /// Whose endorsement the contract needs lies behind the first block that is read: the peer is asked. What it says may
  /// confirm a transaction, not refuse one.
  void ask_definition(Follower& follower) {
    if (!intake_.misses_definition()) return;
    lifecycle::QueryChaincodeDefinitionArgs question;
    question.set_name(connection_->config.where.contract);
    const auto proposal = make_proposal(connection_->config.identity, {connection_->config.where.channel, "_lifecycle"},
                                        {"QueryChaincodeDefinition", {question.SerializeAsString()}}, realtime_ns(),
                                        crypto::random_bytes(24));
    protos::SignedProposal message;
    if (!proposal || !message.ParseFromString(proposal->signed_proposal)) return;
    grpc::ClientContext context;
    const Follower::Cancellable cancellable(follower, context);
    context.set_deadline(std::chrono::system_clock::now() + connection_->config.deadline);
    const auto stub = protos::Endorser::NewStub(connection_->stream_peers[connection_->peer()]);
    protos::ProposalResponse answer;
    const grpc::Status status = stub->ProcessProposal(&context, message, &answer);
    lifecycle::QueryChaincodeDefinitionResult definition;
    std::string problem;
    if (!status.ok()) {
      problem = text_of(status);
    } else if (answer.response().status() != 200) {
      problem = answer.response().message();
    } else if (!definition.ParseFromString(answer.response().payload())) {
      problem = "its answer is malformed";
    } else {
      intake_.define(definition.validation_parameter());
      return;
    }
    if (std::exchange(definition_problem_told_, true) || !handlers_.on_unbelievable) return;
    handlers_.on_unbelievable(fmt::format(
        "the peer does not say whose endorsement contract {} needs ({}): of what makes new keys the flags are "
        "believed",
        connection_->config.where.contract, printable(problem)));
  }

  BlockIntake::Fetch fetcher(Follower& follower) {
    return [this, &follower](std::uint64_t number) {
      auto block = fetch(follower, number);
      failed_fetch_ = failed_fetch_ || !block;
      return block;
    };
  }

  Result<common::Block> fetch(Follower& follower, std::optional<std::uint64_t> number) {
    return fetch_block(*connection_, follower, number);
  }

  std::string contradicted(const std::string& what) {
    if (!failed_fetch_ && handlers_.on_contradiction) handlers_.on_contradiction(what);
    return what;
  }

  std::string take(const protos::DeliverResponse& response, Follower& follower) {
    if (response.Type_case() == protos::DeliverResponse::kStatus) {
      return fmt::format("the peer refused the stream: {}", common::Status_Name(response.status()));
    }
    if (response.Type_case() != protos::DeliverResponse::kBlock) return "the peer sent something else than blocks";
    const TimeNs received_ns = monotonic_ns();
    // "From the next new one on": the newest block that the peer sends first only says where that is.
    const bool wanted = intake_.next().has_value();
    failed_fetch_ = false;
    auto block = intake_.take(response.block(), fetcher(follower));
    if (!block) return contradicted(block.error().what);
    block->received_ns = received_ns;
    if (wanted) tell_unbelievable(*block);
    if (wanted && handlers_.on_block) handlers_.on_block(*block, response.block().SerializeAsString());
    connection_->commits->block(*block);
    return {};
  }

  void tell_unbelievable(const Block& block) {
    for (const Transaction& transaction : block.transactions) {
      if (transaction.problem.empty()) continue;
      ++unbelievable_;
      if (!handlers_.on_unbelievable || (unbelievable_ > 1 && block.received_ns < next_word_ns_)) continue;
      next_word_ns_ = block.received_ns + unbelievable_period_ns;
      handlers_.on_unbelievable(
          fmt::format("block {}: transaction {}: its flag is not believed: {}; left out ({} so far)", block.number,
                      printable(transaction.tx_id), transaction.problem, unbelievable_));
    }
  }

  const std::shared_ptr<const Connection> connection_;
  std::optional<Believed> believed_;  ///< until the chain goes on behind it
  const Client::StreamHandlers handlers_;
  BlockIntake intake_;
  bool failed_fetch_ = false;  ///< what was refused last may be right: the peer did not answer
  int lagged_ = 0;             ///< connections in a row in which the peer's chain ended before the checkpoint
  bool definition_problem_told_ = false;
  std::uint64_t unbelievable_ = 0;
  TimeNs next_word_ns_ = 0;
};

/// What an orderer tells, of which the headers alone count; the next orderer when one goes away.
class OrderedReader {
 public:
  OrderedReader(std::shared_ptr<const Connection> connection, std::shared_ptr<CrossCheck> cross_check)
      : connection_(std::move(connection)), cross_check_(std::move(cross_check)) {}

  std::string follow(Follower& follower) {
    grpc::ClientContext context;
    const Follower::Cancellable cancellable(follower, context);
    const auto stub = orderer::AtomicBroadcast::NewStub(connection_->orderers[which_++ % connection_->orderers.size()]);
    const auto stream = stub->Deliver(&context);
    if (std::string problem = seek(*connection_, *stream, std::nullopt); !problem.empty()) return problem;
    orderer::DeliverResponse response;
    while (stream->Read(&response)) {
      const common::BlockHeader& header = response.block().header();
      if (response.has_block()) {
        (void)cross_check_->add(CrossCheck::Source::orderer, header.number(),
                                block_header_hash(header.number(), header.previous_hash(), header.data_hash()));
        follower.progress();
      }
      if (!response.has_block() || follower.stopping()) context.TryCancel();
    }
    return text_of(stream->Finish());
  }

 private:
  const std::shared_ptr<const Connection> connection_;
  const std::shared_ptr<CrossCheck> cross_check_;
  std::size_t which_ = 0;
};

/// Both run until this is gone.
struct CheckedBlocks final : Client::Stream {
  std::unique_ptr<Client::Stream> blocks, ordered;
};

class EventReader {
 public:
  EventReader(std::shared_ptr<const Connection> connection, std::optional<std::uint64_t> start, std::string after_tx_id,
              std::function<void(const Client::Event&)> on_event)
      : connection_(std::move(connection)), block_(start), on_event_(std::move(on_event)) {
    if (!after_tx_id.empty()) handed_over_.push_back(std::move(after_tx_id));
  }

  std::string follow(Follower& follower) {
    if (!block_) {
      if (std::string problem = find_start(follower); !problem.empty()) return problem;
    }
    gateway::SignedChaincodeEventsRequest request;
    if (std::string problem = make_request(request); !problem.empty()) return problem;
    grpc::ClientContext context;
    const Follower::Cancellable cancellable(follower, context);
    const std::shared_ptr<grpc::Channel>& peer = connection_->stream_peers[connection_->peer()];
    const auto stub = gateway::Gateway::NewStub(peer);
    const auto stream = stub->ChaincodeEvents(&context, request);
    // The first answer may be far off; the question is out when the channel stands.
    if (peer->GetState(false) == GRPC_CHANNEL_READY) follower.connected();
    gateway::ChaincodeEventsResponse response;
    while (stream->Read(&response)) {
      follower.connected();
      std::string problem = take(response, follower);
      if (!problem.empty() || follower.stopping()) {
        context.TryCancel();
        (void)stream->Finish();
        return problem;
      }
      follower.progress();
    }
    return text_of(stream->Finish());
  }

 private:
  /// The position must be known before the first event, else what comes during a lost connection would be lost as well.
  std::string find_start(Follower& follower) {
    const auto newest = fetch_block(*connection_, follower, std::nullopt);
    if (!newest) return newest.error().what;
    block_ = newest->header().number() + 1;
    return {};
  }

  std::string make_request(gateway::SignedChaincodeEventsRequest& request) const {
    gateway::ChaincodeEventsRequest question;
    question.set_channel_id(connection_->config.where.channel);
    question.set_chaincode_id(connection_->config.where.contract);
    question.set_identity(connection_->config.identity.serialized);
    question.mutable_start_position()->mutable_specified()->set_number(*block_);
    if (!handed_over_.empty()) question.set_after_transaction_id(handed_over_.back());
    request.set_request(question.SerializeAsString());
    auto signature = connection_->config.identity.signer->sign(request.request());
    if (!signature) return signature.error().what;
    request.set_signature(std::move(*signature));
    return {};
  }

  std::string take(gateway::ChaincodeEventsResponse& response, Follower& follower) {
    if (response.block_number() < *block_) {
      return fmt::format("events of block {} came where {} was due", response.block_number(), *block_);
    }
    for (protos::ChaincodeEvent& event : *response.mutable_events()) {
      if (follower.stopping()) break;
      if (response.block_number() != *block_) handed_over_.clear();
      block_ = response.block_number();
      // A transaction has one event; after a reconnect the peer may send the block's first ones again.
      if (std::find(handed_over_.begin(), handed_over_.end(), event.tx_id()) != handed_over_.end()) continue;
      handed_over_.push_back(event.tx_id());
      on_event_({*block_, event.tx_id(), std::move(*event.mutable_event_name()), std::move(*event.mutable_payload())});
    }
    return {};
  }

  const std::shared_ptr<const Connection> connection_;
  std::optional<std::uint64_t> block_;    ///< of the last event handed over, or where to start
  std::vector<std::string> handed_over_;  ///< transactions of that block
  const std::function<void(const Client::Event&)> on_event_;
};

}  // namespace

Follower::Follower(std::function<std::string(Follower&)> follow, OnConnection on_connection)
    : follow_(std::move(follow)),
      on_connection_(std::move(on_connection)),
      back_off_(first_reconnect_ns, max_reconnect_ns),
      thread_([this] { run(); }) {}

Follower::~Follower() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    if (context_ != nullptr) context_->TryCancel();
    wake_.notify_all();
  }
  thread_.join();
}

Follower::Cancellable::Cancellable(Follower& follower, grpc::ClientContext& context) : follower_(follower) {
  const std::lock_guard lock(follower_.mutex_);
  outer_ = std::exchange(follower_.context_, &context);
  if (follower_.stopping_) context.TryCancel();
}

Follower::Cancellable::~Cancellable() {
  const std::lock_guard lock(follower_.mutex_);
  follower_.context_ = outer_;
}

bool Follower::stopping() {
  const std::lock_guard lock(mutex_);
  return stopping_;
}

void Follower::connected() {
  if (connected_) return;
  connected_ = true;
  last_why_.clear();
  if (on_connection_) on_connection_(true, "");
}

void Follower::run() {
  while (!stopping()) {
    const std::string why = follow_(*this);
    if (stopping()) return;
    const bool news = connected_ || why != last_why_;
    connected_ = false;
    last_why_ = why;
    if (news && on_connection_) on_connection_(false, why);
    std::unique_lock lock(mutex_);
    wake_.wait_for(lock, std::chrono::nanoseconds(back_off_.next(random_)), [this] { return stopping_; });
  }
}

std::unique_ptr<Client::Stream> follow_blocks(std::shared_ptr<const Connection> connection, BlocksFrom from,
                                              Client::StreamHandlers handlers) {
  auto on_connection = handlers.on_connection;
  const bool checked = connection->config.cross_check && !connection->orderers.empty();
  const auto cross_check = checked ? std::make_shared<CrossCheck>() : nullptr;
  const auto run = [](auto reader, Follower::OnConnection tell) {
    return std::make_unique<Follower>([reader](Follower& f) { return reader->follow(f); }, std::move(tell));
  };
  auto blocks = run(std::make_shared<BlockReader>(connection, std::move(from), std::move(handlers), cross_check),
                    std::move(on_connection));
  if (!checked) return blocks;
  auto both = std::make_unique<CheckedBlocks>();
  both->blocks = std::move(blocks);
  both->ordered = run(std::make_shared<OrderedReader>(connection, cross_check), nullptr);
  return both;
}

std::unique_ptr<Client::Stream> follow_events(std::shared_ptr<const Connection> connection,
                                              std::optional<std::uint64_t> start, std::string after_tx_id,
                                              std::function<void(const Client::Event&)> on_event,
                                              Follower::OnConnection on_connection) {
  auto reader =
      std::make_shared<EventReader>(std::move(connection), start, std::move(after_tx_id), std::move(on_event));
  return std::make_unique<Follower>([reader](Follower& f) { return reader->follow(f); }, std::move(on_connection));
}

}  // namespace ledgerline::fabric
