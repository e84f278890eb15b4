#include <gmock/gmock.h>

#include <thread>

#include "gateway/gateway.grpc.pb.h"
#include "orderer/ab.grpc.pb.h"
#include "peer/events.grpc.pb.h"
#include "peer/peer.grpc.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/chaincode/node/core/high_s.hpp"
#include "tests/unit/chaincode/node/server/served_node.hpp"

/// The node over gRPC: each call is answered, and refused, with the status that a peer and an orderer of Fabric 2.5
/// were measured to give.
namespace ledgerline::node {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const std::string good_call = R"({"id":"tello1/note","msgType":"t"})";

/// What a call ended with: gRPC's status, and what gateway.ErrorDetail in it says.
struct Ended {
  grpc::StatusCode code;
  std::string message;
  std::string detail;
};

Ended ended(const grpc::Status& status) {
  return {status.error_code(), status.error_message(), status.error_details()};
}

class ServicesTest : public ::testing::Test {
 protected:
  explicit ServicesTest(ServedNode::Clients clients = ServedNode::Clients::any)
      : served(ServedNode::settings(), clients) {}

  static std::unique_ptr<grpc::ClientContext> within(int seconds = 20) {
    auto context = std::make_unique<grpc::ClientContext>();
    context->set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(seconds));
    return context;
  }

  protos::SignedProposal propose(const crypto::SigningIdentity& who, const std::string& argument = good_call,
                                 const fabric::ChannelAndContract& where = {}, const std::string& function = "set") {
    const auto proposal =
        fabric::make_proposal(who, where, {function, {argument}}, realtime_ns(), crypto::random_bytes(24));
    protos::SignedProposal signed_proposal;
    EXPECT_TRUE(signed_proposal.ParseFromString(proposal->signed_proposal));
    tx_id = proposal->tx_id;
    return signed_proposal;
  }

  Ended endorse(const protos::SignedProposal& proposal) {
    gateway::EndorseRequest request;
    gateway::EndorseResponse response;
    *request.mutable_proposed_transaction() = proposal;
    const Ended end = ended(gateway->Endorse(within().get(), request, &response));
    endorsed = response.prepared_transaction();
    return end;
  }
  Ended evaluate(const protos::SignedProposal& proposal) {
    gateway::EvaluateRequest request;
    gateway::EvaluateResponse response;
    *request.mutable_proposed_transaction() = proposal;
    return ended(gateway->Evaluate(within().get(), request, &response));
  }
  Ended process(const protos::SignedProposal& proposal, protos::ProposalResponse* response) {
    return ended(endorser->ProcessProposal(within().get(), proposal, response));
  }
  Ended submit(const common::Envelope& envelope) {
    gateway::SubmitRequest request;
    gateway::SubmitResponse response;
    *request.mutable_prepared_transaction() = envelope;
    return ended(gateway->Submit(within().get(), request, &response));
  }
  orderer::BroadcastResponse broadcast(const common::Envelope& envelope) {
    const auto context = within();
    const auto stream = ordering->Broadcast(context.get());
    orderer::BroadcastResponse response;
    EXPECT_TRUE(stream->Write(envelope));
    EXPECT_TRUE(stream->Read(&response));
    stream->WritesDone();
    EXPECT_TRUE(stream->Finish().ok());
    return response;
  }

  /// Endorsed and signed by `who`.
  common::Envelope envelope_of(const crypto::SigningIdentity& who) {
    EXPECT_EQ(endorse(propose(who)).code, grpc::StatusCode::OK);
    common::Envelope envelope;
    EXPECT_TRUE(envelope.ParseFromString(*fabric::sign_envelope(who, endorsed.SerializeAsString())));
    return envelope;
  }

  /// With another header, signed by the host.
  common::Envelope changed(common::Envelope envelope, const std::function<void(common::Header&)>& change) {
    common::Payload payload;
    EXPECT_TRUE(payload.ParseFromString(envelope.payload()));
    change(*payload.mutable_header());
    envelope.set_payload(payload.SerializeAsString());
    envelope.set_signature(*host.signer->sign(envelope.payload()));
    return envelope;
  }

  Ended status_of(const crypto::SigningIdentity& who, const std::string& id, gateway::CommitStatusResponse* response,
                  int seconds = 20, const std::string& channel = "teleop") {
    gateway::CommitStatusRequest request;
    request.set_transaction_id(id);
    request.set_channel_id(channel);
    request.set_identity(who.serialized);
    gateway::SignedCommitStatusRequest signed_request;
    signed_request.set_request(request.SerializeAsString());
    signed_request.set_signature(*who.signer->sign(signed_request.request()));
    return ended(gateway->CommitStatus(within(seconds).get(), signed_request, response));
  }

  /// The first event's transaction is in `tx_id`.
  Ended events(const crypto::SigningIdentity& who, const std::string& channel = "teleop",
               const std::function<void(gateway::ChaincodeEventsRequest&)>& change = {}) {
    gateway::ChaincodeEventsRequest request;
    request.set_channel_id(channel);
    request.set_chaincode_id("ledgerline");
    request.set_identity(who.serialized);
    request.mutable_start_position()->mutable_specified()->set_number(0);
    if (change) change(request);
    gateway::SignedChaincodeEventsRequest signed_request;
    signed_request.set_request(request.SerializeAsString());
    signed_request.set_signature(*who.signer->sign(signed_request.request()));
    const auto context = within();
    const auto stream = gateway->ChaincodeEvents(context.get(), signed_request);
    gateway::ChaincodeEventsResponse response;
    if (stream->Read(&response)) {
      tx_id = response.events(0).tx_id();
      context->TryCancel();
      (void)stream->Finish();
      return {grpc::StatusCode::OK, {}, {}};
    }
    return ended(stream->Finish());
  }

  /// A seek for the blocks 0 to 1, or with another stop.
  common::Envelope seek(const crypto::SigningIdentity& who, const std::string& channel = "teleop",
                        std::uint64_t stop = 1) {
    common::Envelope envelope;
    EXPECT_TRUE(envelope.ParseFromString(*fabric::make_seek(who, channel, 0, realtime_ns(), std::string(24, 'n'))));
    common::Payload payload;
    orderer::SeekInfo info;
    EXPECT_TRUE(payload.ParseFromString(envelope.payload()) && info.ParseFromString(payload.data()));
    info.mutable_stop()->mutable_specified()->set_number(stop);
    payload.set_data(info.SerializeAsString());
    envelope.set_payload(payload.SerializeAsString());
    envelope.set_signature(*who.signer->sign(envelope.payload()));
    return envelope;
  }
  /// Reads a stream of blocks up to its status; `blocks` counts what came before it.
  template <typename Response, typename Stream>
  common::Status read_to_status(Stream stream, const common::Envelope& envelope) {
    Response response;
    EXPECT_TRUE(stream->Write(envelope));
    stream->WritesDone();
    common::Status status = common::UNKNOWN;
    while (stream->Read(&response)) {
      if (response.Type_case() == Response::kStatus) {
        status = response.status();
      } else {
        ++blocks;
      }
    }
    EXPECT_TRUE(stream->Finish().ok());
    return status;
  }
  std::vector<common::Status> deliver_everywhere(const common::Envelope& envelope) {
    std::vector<common::Status> statuses;
    blocks = 0;
    using Peer = protos::DeliverResponse;
    auto context = within();
    statuses.push_back(read_to_status<Peer>(blocks_of->Deliver(context.get()), envelope));
    context = within();
    statuses.push_back(read_to_status<Peer>(blocks_of->DeliverFiltered(context.get()), envelope));
    context = within();
    statuses.push_back(read_to_status<Peer>(blocks_of->DeliverWithPrivateData(context.get()), envelope));
    context = within();
    statuses.push_back(read_to_status<orderer::DeliverResponse>(ordering->Deliver(context.get()), envelope));
    return statuses;
  }

  /// With the certificate's hash in it, as who shows one of TLS says which.
  common::Envelope naming(const common::Envelope& seek, const std::string& tls_hash) {
    return changed(seek, [&](common::Header& header) {
      common::ChannelHeader channel_header;
      channel_header.ParseFromString(header.channel_header());
      channel_header.set_tls_cert_hash(tls_hash);
      header.set_channel_header(channel_header.SerializeAsString());
    });
  }

  ServedNode served;
  const std::shared_ptr<grpc::Channel> channel = served.connect();
  const std::unique_ptr<gateway::Gateway::Stub> gateway = gateway::Gateway::NewStub(channel);
  const std::unique_ptr<protos::Endorser::Stub> endorser = protos::Endorser::NewStub(channel);
  const std::unique_ptr<protos::Deliver::Stub> blocks_of = protos::Deliver::NewStub(channel);
  const std::unique_ptr<orderer::AtomicBroadcast::Stub> ordering = orderer::AtomicBroadcast::NewStub(channel);
  const crypto::SigningIdentity host = served.user(1, "User1");
  std::string tx_id;
  common::Envelope endorsed;
  int blocks = 0;
};

TEST_F(ServicesTest, ATransactionIsEndorsedSubmittedAndConfirmed) {
  const common::Envelope envelope = envelope_of(host);
  EXPECT_EQ(submit(envelope).code, grpc::StatusCode::OK);
  gateway::CommitStatusResponse status;
  EXPECT_EQ(status_of(host, tx_id, &status).code, grpc::StatusCode::OK);
  EXPECT_EQ(status.result(), protos::VALID);
  EXPECT_EQ(status.block_number(), 4U);
  EXPECT_EQ(events(host).code, grpc::StatusCode::OK);
}

TEST_F(ServicesTest, TheDirectPathDoesTheSame) {
  protos::ProposalResponse response;
  EXPECT_EQ(process(propose(host), &response).code, grpc::StatusCode::OK);
  EXPECT_EQ(response.response().status(), 200);
  EXPECT_FALSE(response.endorsement().signature().empty());
  EXPECT_EQ(broadcast(envelope_of(host)).status(), common::SUCCESS);
  gateway::CommitStatusResponse status;
  status_of(host, tx_id, &status);
  EXPECT_EQ(status.result(), protos::VALID);
}

TEST_F(ServicesTest, ARefusalOfTheContractHasItsWords) {
  const std::string foreign = R"({"id":"Org2MSP/a","msgType":"t"})";
  const Ended end = endorse(propose(host, foreign));
  EXPECT_EQ(end.code, grpc::StatusCode::ABORTED);
  EXPECT_THAT(end.detail, HasSubstr("chaincode response 500, "));
  const Ended evaluated = evaluate(propose(host, foreign));
  EXPECT_EQ(evaluated.code, grpc::StatusCode::UNKNOWN);
  EXPECT_THAT(evaluated.message, HasSubstr("chaincode response 500, "));
  protos::ProposalResponse response;
  EXPECT_EQ(process(propose(host, foreign), &response).code, grpc::StatusCode::OK) << "as Fabric's endorser";
  EXPECT_EQ(response.response().status(), 500);
  EXPECT_FALSE(response.has_endorsement());
}

/// Each is refused by every service with the code that Fabric has for it.
TEST_F(ServicesTest, WhoIsNoMemberIsDeniedEverywhere) {
  const auto other_ca = *crypto::make_ca("ca.org1.ledgerline", "org1.ledgerline");
  const crypto::SigningIdentity user2 = served.user(1, "User2");
  crypto::SigningIdentity forger = host;  // says that it is User1 and signs with another key
  forger.signer = user2.signer;
  crypto::SigningIdentity high_s = host;
  high_s.signer = std::make_shared<HighSSigner>(host.signer);
  const std::map<std::string, crypto::SigningIdentity> outsiders{
      {"wrong signature", forger},
      {"high S", high_s},
      {"unknown CA", ServedNode::identity_of(other_ca, "Org1MSP", 10)},
      {"unknown MSP", served.issued(10, "Org9MSP")},
      {"wrong MSP", served.issued(10, "Org2MSP")},
      {"expired", served.issued(-1)}};
  for (const auto& [what, who] : outsiders) {
    SCOPED_TRACE(what);
    const Ended end = endorse(propose(who));
    EXPECT_EQ(end.code, grpc::StatusCode::ABORTED);
    EXPECT_THAT(end.detail, HasSubstr("error validating proposal: access denied: "));
    EXPECT_EQ(evaluate(propose(who)).code, grpc::StatusCode::FAILED_PRECONDITION);
    protos::ProposalResponse response;
    const Ended direct = process(propose(who), &response);
    EXPECT_EQ(direct.code, grpc::StatusCode::UNKNOWN);
    EXPECT_THAT(direct.message, HasSubstr("access denied: "));

    common::Envelope envelope = envelope_of(host);
    if (who.serialized == host.serialized) {
      envelope.set_signature(*who.signer->sign(envelope.payload()));
      const Ended submitted = submit(envelope);
      EXPECT_EQ(submitted.code, grpc::StatusCode::ABORTED);
      EXPECT_THAT(submitted.message, HasSubstr("from orderer: status=FORBIDDEN"));
      EXPECT_EQ(broadcast(envelope).status(), common::FORBIDDEN);
    }
    gateway::CommitStatusResponse status;
    EXPECT_EQ(status_of(who, tx_id, &status).code, grpc::StatusCode::PERMISSION_DENIED);
    EXPECT_EQ(events(who).code, grpc::StatusCode::PERMISSION_DENIED);
    EXPECT_THAT(deliver_everywhere(seek(who)), ::testing::Each(common::FORBIDDEN));
    EXPECT_EQ(blocks, 0);
  }
  EXPECT_EQ(endorse(propose(served.issued(10))).code, grpc::StatusCode::ABORTED) << "a member who owns nothing";
  EXPECT_THAT(deliver_everywhere(seek(served.issued(10))), ::testing::Each(common::SUCCESS)) << "and may read";
}

TEST_F(ServicesTest, OtherChannelsAndContractsAreReported) {
  EXPECT_EQ(endorse(propose(host, good_call, {"other", "ledgerline"})).code, grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(evaluate(propose(host, good_call, {"other", "ledgerline"})).code, grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(endorse(propose(host, good_call, {"teleop", "other"})).code, grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(evaluate(propose(host, good_call, {"teleop", "other"})).code, grpc::StatusCode::FAILED_PRECONDITION);
  for (const fabric::ChannelAndContract& where :
       {fabric::ChannelAndContract{"other", "ledgerline"}, fabric::ChannelAndContract{"teleop", "other"}}) {
    protos::ProposalResponse response;
    EXPECT_EQ(process(propose(host, good_call, where), &response).code, grpc::StatusCode::OK);
    EXPECT_EQ(response.response().status(), 500);
  }
  EXPECT_THAT(deliver_everywhere(seek(host, "other")), ::testing::Each(common::NOT_FOUND));
  EXPECT_EQ(events(host, "other").code, grpc::StatusCode::PERMISSION_DENIED);
  gateway::CommitStatusResponse status;
  EXPECT_EQ(status_of(host, "any", &status, 20, "other").code, grpc::StatusCode::PERMISSION_DENIED);
  const common::Envelope elsewhere = changed(envelope_of(host), [](common::Header& header) {
    common::ChannelHeader channel_header;
    channel_header.ParseFromString(header.channel_header());
    channel_header.set_channel_id("other");
    header.set_channel_header(channel_header.SerializeAsString());
  });
  EXPECT_EQ(submit(elsewhere).code, grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(broadcast(elsewhere).status(), common::BAD_REQUEST);
}

TEST_F(ServicesTest, WhoseCertificateHasExpiredCannotSubmitWhatWasEndorsedBefore) {
  const crypto::SigningIdentity expired = served.issued(-1);
  common::Envelope envelope = changed(envelope_of(host), [&](common::Header& header) {
    common::SignatureHeader signer;
    signer.ParseFromString(header.signature_header());
    signer.set_creator(expired.serialized);
    header.set_signature_header(signer.SerializeAsString());
  });
  envelope.set_signature(*expired.signer->sign(envelope.payload()));
  const orderer::BroadcastResponse response = broadcast(envelope);
  EXPECT_EQ(response.status(), common::BAD_REQUEST);
  EXPECT_EQ(response.info(), "broadcast client identity expired");
  EXPECT_THAT(submit(envelope).message, HasSubstr("status=BAD_REQUEST, info=broadcast client identity expired"));
}

TEST_F(ServicesTest, ARequestForBlocksThatSomebodyHasKeptIsRefused) {
  const auto sent = [&](std::optional<std::int64_t> real_s) {
    common::Envelope envelope = changed(seek(host), [&](common::Header& header) {
      common::ChannelHeader channel_header;
      channel_header.ParseFromString(header.channel_header());
      channel_header.clear_timestamp();
      if (real_s) channel_header.mutable_timestamp()->set_seconds(*real_s);
      header.set_channel_header(channel_header.SerializeAsString());
    });
    return deliver_everywhere(envelope);
  };
  constexpr std::int64_t minute = 60;
  const std::int64_t now = realtime_ns() / ns_per_s;
  for (const std::int64_t good : {now - 14 * minute, now, now + 14 * minute}) {
    EXPECT_THAT(sent(good), ::testing::Each(common::SUCCESS));
  }
  using Bad = std::optional<std::int64_t>;
  for (const Bad bad : {Bad(now - 16 * minute), Bad(now + 16 * minute), Bad(0), Bad(), Bad(INT64_MIN), Bad(INT64_MAX),
                        Bad(INT64_MAX / ns_per_s)}) {
    EXPECT_THAT(sent(bad), ::testing::Each(common::BAD_REQUEST));
    EXPECT_EQ(blocks, 0);
  }
}

TEST_F(ServicesTest, EventsGoOnBehindATransactionWhereverItIs) {
  std::vector<std::string> written;
  for (int i = 0; i < 3; ++i) {
    const common::Envelope envelope = envelope_of(host);
    written.push_back(tx_id);
    EXPECT_EQ(submit(envelope).code, grpc::StatusCode::OK);
    gateway::CommitStatusResponse status;
    EXPECT_EQ(status_of(host, tx_id, &status).code, grpc::StatusCode::OK);
  }
  for (const std::uint64_t start : {0, 1000}) {
    EXPECT_EQ(events(host, "teleop",
                     [&](gateway::ChaincodeEventsRequest& request) {
                       request.mutable_start_position()->mutable_specified()->set_number(start);
                       request.set_after_transaction_id(written[1]);
                     })
                  .code,
              grpc::StatusCode::OK);
    EXPECT_EQ(tx_id, written[2]);
  }
}

TEST_F(ServicesTest, EventsBeginAtABlocksNumberOrNow) {
  const auto oldest = [](gateway::ChaincodeEventsRequest& request) {
    request.mutable_start_position()->mutable_oldest();
  };
  const auto newest = [](gateway::ChaincodeEventsRequest& request) {
    request.mutable_start_position()->mutable_newest();
  };
  EXPECT_EQ(events(host, "teleop", oldest).code, grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(events(host, "teleop", newest).code, grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServicesTest, WhatDoesNotParseIsReported) {
  protos::SignedProposal proposal = propose(host);
  proposal.set_proposal_bytes("\xff\xff\xff");
  EXPECT_EQ(endorse(proposal).code, grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_EQ(evaluate(proposal).code, grpc::StatusCode::INVALID_ARGUMENT);
  protos::ProposalResponse response;
  EXPECT_EQ(process(proposal, &response).code, grpc::StatusCode::UNKNOWN);
  common::Envelope envelope;
  envelope.set_payload("\xff\xff\xff");
  EXPECT_THAT(submit(envelope).message, HasSubstr("status=BAD_REQUEST"));
  EXPECT_EQ(broadcast(envelope).status(), common::BAD_REQUEST);
  EXPECT_THAT(deliver_everywhere(envelope), ::testing::Each(common::BAD_REQUEST));
  EXPECT_THAT(deliver_everywhere(common::Envelope()), ::testing::Each(common::BAD_REQUEST));
  gateway::SignedCommitStatusRequest status_request;
  status_request.set_request("\xff\xff\xff");
  gateway::CommitStatusResponse status;
  EXPECT_EQ(ended(gateway->CommitStatus(within().get(), status_request, &status)).code,
            grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServicesTest, AnEnvelopeThatIsTooLargeIsReportedItsSize) {
  common::Envelope envelope = envelope_of(host);
  envelope.mutable_payload()->append(served.config().max_envelope_bytes, 'x');
  envelope.set_signature(*host.signer->sign(envelope.payload()));
  const std::string size = std::to_string(envelope.payload().size() + envelope.signature().size());
  const Ended end = submit(envelope);
  EXPECT_EQ(end.code, grpc::StatusCode::ABORTED);
  EXPECT_THAT(end.message, HasSubstr("status=BAD_REQUEST, info=message payload is " + size + " bytes and exceeds"));
  EXPECT_EQ(broadcast(envelope).status(), common::BAD_REQUEST);
  envelope.mutable_payload()->append(2'000'000, 'x');
  EXPECT_EQ(submit(envelope).code, grpc::StatusCode::RESOURCE_EXHAUSTED) << "gRPC's own limit";
}

TEST_F(ServicesTest, AStatusThatNeverComesIsNotAnswered) {
  gateway::CommitStatusResponse status;
  EXPECT_EQ(status_of(host, std::string(64, 'a'), &status, 1).code, grpc::StatusCode::DEADLINE_EXCEEDED);
}

TEST_F(ServicesTest, BlocksAreDeliveredUpToTheStop) {
  EXPECT_THAT(deliver_everywhere(seek(host)), ::testing::Each(common::SUCCESS));
  EXPECT_EQ(blocks, 4 * 2);
}

TEST_F(ServicesTest, WithoutMutualTlsACertificatesHashIsNotCompared) {
  EXPECT_THAT(deliver_everywhere(naming(seek(host), "any")), ::testing::Each(common::SUCCESS));
}

class MutualTlsTest : public ServicesTest {
 protected:
  MutualTlsTest() : ServicesTest(ServedNode::Clients::with_certificate) {}

  std::string hash_of(const std::string& user) const {
    const auto hash = crypto::certificate_hash(text_of(served.tls_of_user(user) / "client.crt"));
    return {hash->begin(), hash->end()};
  }
};

/// The connection is User1's: a request of another one's, sent on over it, brings no blocks.
TEST_F(MutualTlsTest, BlocksAreDeliveredByTheConnectionAloneThatTheRequestNames) {
  const std::string own = hash_of("User1");
  EXPECT_THAT(deliver_everywhere(naming(seek(host), own)), ::testing::Each(common::SUCCESS));
  EXPECT_EQ(blocks, 4 * 2);
  for (const std::string& other : {hash_of("User2"), std::string(), own.substr(1), own + "x"}) {
    EXPECT_THAT(deliver_everywhere(naming(seek(host), other)), ::testing::Each(common::BAD_REQUEST));
    EXPECT_EQ(blocks, 0);
  }
  EXPECT_EQ(endorse(propose(host)).code, grpc::StatusCode::OK) << "as in Fabric: Deliver alone is bound";
}

/// More than the limit of open calls, by somebody who has no certificate: silent ones, and ones that were refused.
TEST_F(ServicesTest, StreamsOfOutsidersTakeNoPlaceOfMembers) {
  constexpr int many = 2'600, timeout_s = 300;  // not a limit on speed: only how long a broken test may take
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReaderWriter<common::Envelope, protos::DeliverResponse>>> readers;
  std::vector<std::unique_ptr<grpc::ClientReaderWriter<common::Envelope, orderer::BroadcastResponse>>> writers;
  for (int i = 0; i < many; ++i) {
    readers.push_back(blocks_of->Deliver(contexts.emplace_back(within(timeout_s)).get()));
    writers.push_back(ordering->Broadcast(contexts.emplace_back(within(timeout_s)).get()));
    if (i % 100 == 0) writers.back()->Write(common::Envelope());
  }
  EXPECT_THAT(deliver_everywhere(seek(host)), ::testing::Each(common::SUCCESS));
  EXPECT_EQ(broadcast(envelope_of(host)).status(), common::SUCCESS);
  protos::DeliverResponse response;
  EXPECT_FALSE(readers.front()->Read(&response)) << "the oldest has ended";
  EXPECT_EQ(readers.front()->Finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  for (const auto& context : contexts) context->TryCancel();
}

TEST_F(ServicesTest, CallsBeyondTheLimitAreRefusedAndOtherServicesGoOn) {
  gateway::CommitStatusRequest request;
  request.set_transaction_id("never");
  request.set_channel_id("teleop");
  request.set_identity(host.serialized);
  gateway::SignedCommitStatusRequest signed_request;
  signed_request.set_request(request.SerializeAsString());
  signed_request.set_signature(*host.signer->sign(signed_request.request()));
  struct Waiting {
    std::unique_ptr<grpc::ClientContext> context = within();
    gateway::CommitStatusResponse response;
  };
  constexpr int most = 2500, more = 20;
  std::vector<Waiting> calls(most + more);
  std::mutex mutex;
  std::condition_variable ended;
  int refused = 0, other = 0;
  std::string refusal;
  for (Waiting& call : calls) {
    gateway->async()->CommitStatus(call.context.get(), &signed_request, &call.response, [&](const grpc::Status& end) {
      const std::lock_guard lock(mutex);
      const bool full = end.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED;
      ++(full ? refused : other);
      if (full) refusal = end.error_message();
      ended.notify_one();
    });
  }
  std::unique_lock lock(mutex);
  ended.wait(lock, [&] { return refused + other >= more; });
  EXPECT_EQ(refused, more);
  EXPECT_THAT(refusal, HasSubstr("exceeding concurrency limit (2500)"));
  lock.unlock();
  EXPECT_THAT(deliver_everywhere(seek(host)), ::testing::Each(common::SUCCESS));
  EXPECT_EQ(endorse(propose(host)).code, grpc::StatusCode::OK);
  gateway::CommitStatusResponse status;
  EXPECT_EQ(status_of(host, "one more", &status).code, grpc::StatusCode::RESOURCE_EXHAUSTED);
  for (Waiting& call : calls) call.context->TryCancel();
  lock.lock();
  ended.wait(lock, [&] { return refused + other == most + more; });
  lock.unlock();
  // A place is free once the node has seen the end of its call.
  const auto asked = [&] { return status_of(host, "never", &status, 1).code; };
  for (int i = 0; i < 20 && asked() == grpc::StatusCode::RESOURCE_EXHAUSTED; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  EXPECT_EQ(asked(), grpc::StatusCode::DEADLINE_EXCEEDED);
}

}  // namespace
}  // namespace ledgerline::node
