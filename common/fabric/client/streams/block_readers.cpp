#include "common/fabric/client/streams/block_readers.hpp"

#include <fmt/format.h>

#include "common/base/text.hpp"
#include "orderer/ab.grpc.pb.h"
#include "peer/events.grpc.pb.h"
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

BlockIntake::Fetch fetcher(const Connection& connection, Follower& follower) {
  return [&](std::uint64_t number) { return fetch_block(connection, follower, number); };
}

}  // namespace

std::string BlockReader::follow(Follower& follower) {
  if (std::string problem = continue_chain(follower); !problem.empty()) return problem;
  ask_definition(follower);
  grpc::ClientContext context;
  const Follower::Cancellable cancellable(follower, context);
  const std::size_t peer = connection_->peer();
  const auto channels = connection_->channels();
  const auto stub = protos::Deliver::NewStub(channels->stream_peers[peer]);
  const auto stream = stub->Deliver(&context);
  const auto start = blocks_->begin();
  if (std::string problem = seek(*connection_, *stream, channels->peer_tls_hashes[peer], start); !problem.empty())
    return problem;
  std::optional<Seeing> seeing;
  if (start && blocks_->contradiction().empty()) {
    seeing.emplace(*connection_->commits);
    follower.connected();
  }
  protos::DeliverResponse response;
  for (bool first = true; stream->Read(&response); first = false) {
    if (first) blocks_->peer_connected();
    std::string problem = take(response, follower);
    const std::string contradiction = blocks_->contradiction();
    if (seeing && problem.empty())
      problem = contradiction;  // an orderer's block showed it: this connection is lost by it
    if (!problem.empty() || follower.stopping()) {
      context.TryCancel();
      (void)stream->Finish();
      return problem;
    }
    if (!contradiction.empty()) continue;  // read on for stops alone: it is no connection to the ledger
    if (!seeing) seeing.emplace(*connection_->commits);
    follower.connected();
    follower.progress();
  }
  return text_of(stream->Finish());
}

/// Finds the place behind the checkpoint, where there is one; once.
std::string BlockReader::continue_chain(Follower& follower) {
  if (!verified_) return {};
  const auto newest = fetch_block(*connection_, follower, std::nullopt);
  if (!newest) return newest.error().message;
  NotedFetch noted(fetcher(*connection_, follower));
  const auto on = blocks_->continue_chain(*verified_, *newest, std::ref(noted));
  if (!on) {
    // A peer that lags behind may be honest, for a moment.
    const bool lags = newest->header().number() < verified_->last.number;
    lagged_ = lags ? lagged_ + 1 : 0;
    if ((!lags || lagged_ >= max_lags) && !noted.failed()) blocks_->contradicted(on.error().message);
    return on.error().message;
  }
  verified_.reset();
  if (on_continued_) on_continued_(*on);
  return {};
}

/// Whose endorsement the contract needs lies behind the first block that is read: the peer is asked. What it says may
/// confirm a transaction, not refuse one. A peer that is busy or has just started may be late: it is asked again a few
/// times, since an endorser ends without the answer. After these tries have failed, each further connection asks once.
void BlockReader::ask_definition(Follower& follower) {
  if (!blocks_->misses_definition()) return;
  BackOff back_off(first_question_pause_ns, max_question_pause_ns);
  Random random(random_seed());
  const int tries = definition_problem_reported_ ? 1 : max_questions;
  DefinitionAnswer answer;
  int tried = 0;
  do {
    if (tried > 0 && !follower.pause(back_off.next(random))) return;
    answer = definition_of_peer(follower);
    ++tried;
    if (answer.policy) return blocks_->define(*answer.policy);
  } while (answer.may_pass && tried < tries && !follower.stopping());
  if (follower.stopping() || std::exchange(definition_problem_reported_, true)) return;
  blocks_->report_unverified(fmt::format(
      "the peer does not say whose endorsement contract {} needs, asked {} ({}): of what makes new keys the flags are "
      "trusted",
      connection_->config.where.contract, tried == 1 ? "once" : fmt::format("{} times", tried),
      printable(answer.problem)));
}

BlockReader::DefinitionAnswer BlockReader::definition_of_peer(Follower& follower) const {
  lifecycle::QueryChaincodeDefinitionArgs question;
  question.set_name(connection_->config.where.contract);
  const auto proposal = make_proposal(*connection_->signing(), {connection_->config.where.channel, "_lifecycle"},
                                      {"QueryChaincodeDefinition", {question.SerializeAsString()}}, realtime_ns(),
                                      crypto::random_bytes(24));
  if (!proposal) return {.problem = proposal.error().message};
  protos::SignedProposal message;
  if (!message.ParseFromString(proposal->signed_proposal)) return {.problem = "the question is malformed"};
  grpc::ClientContext context;
  const Follower::Cancellable cancellable(follower, context);
  context.set_deadline(std::chrono::system_clock::now() + connection_->config.deadline);
  const auto stub = protos::Endorser::NewStub(connection_->channels()->stream_peers[connection_->peer()]);
  protos::ProposalResponse answer;
  const grpc::Status status = stub->ProcessProposal(&context, message, &answer);
  if (!status.ok())
    return {.problem = text_of(status),
            .may_pass = may_pass(status) || status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED};
  if (answer.response().status() != 200) return {.problem = answer.response().message()};
  lifecycle::QueryChaincodeDefinitionResult definition;
  if (!definition.ParseFromString(answer.response().payload())) return {.problem = "its answer is malformed"};
  return {.policy = definition.validation_parameter()};
}

std::string BlockReader::take(const protos::DeliverResponse& response, Follower& follower) {
  if (response.Type_case() == protos::DeliverResponse::kStatus)
    return fmt::format("the peer refused the stream: {}", common::Status_Name(response.status()));
  if (response.Type_case() != protos::DeliverResponse::kBlock) return "the peer sent something else than blocks";
  BlockHandOver::TakeResult result =
      blocks_->on_peer_block(response.block(), monotonic_ns(), fetcher(*connection_, follower));
  if (result.end_orderer && interrupt_ordered_) interrupt_ordered_();
  return std::move(result.problem);
}

std::string OrderedReader::follow(Follower& follower) {
  const auto start = blocks_->begin_ordered();
  if (!start) return {};  // the peer's stream comes first
  grpc::ClientContext context;
  const Follower::Cancellable cancellable(follower, context);
  const auto channels = connection_->channels();
  const std::size_t at = which_++ % channels->stream_orderers.size();
  const auto stub = orderer::AtomicBroadcast::NewStub(channels->stream_orderers[at]);
  const auto stream = stub->Deliver(&context);
  if (std::string problem = seek(*connection_, *stream, channels->orderer_tls_hashes[at], start); !problem.empty())
    return problem;
  orderer::DeliverResponse response;
  while (stream->Read(&response)) {
    std::string problem =
        response.has_block() ? blocks_->on_ordered_block(std::move(*response.mutable_block()), monotonic_ns())
                             : fmt::format("an orderer refused the stream: {}", common::Status_Name(response.status()));
    if (!problem.empty() || follower.stopping()) {
      context.TryCancel();
      (void)stream->Finish();
      return problem;
    }
    if (!blocks_->contradiction().empty()) continue;
    follower.connected();
    follower.progress();
  }
  const grpc::Status status = stream->Finish();
  const std::string withheld = blocks_->why_orderer_ended();
  return withheld.empty() ? text_of(status) : withheld;
}

}  // namespace ledgerline::fabric
