#include "tests/system/relay/lying_blocks.hpp"

#include <chrono>

#include "common/fabric/tx/transaction.hpp"
#include "gateway/gateway.grpc.pb.h"
#include "hil/sitl/ledger/serving_peer.hpp"
#include "orderer/ab.pb.h"

namespace ledgerline {
namespace {

using hil::parsed;

// A block that is held back by its age has no other sign of its time.
constexpr auto look_again = std::chrono::milliseconds(10);

/// A stop number of its own: the first block alone.
bool one_alone(const orderer::SeekInfo& seek) {
  return seek.stop().has_newest() || (seek.stop().has_specified() && seek.start().has_specified() &&
                                      seek.stop().specified().number() == seek.start().specified().number());
}

std::string creator_of(const common::Payload& payload) {
  return parsed<common::SignatureHeader>(payload.header().signature_header()).creator();
}

}  // namespace

LyingBlocks::LyingBlocks(Setup setup) : setup_(std::move(setup)), stub_(protos::Deliver::NewStub(setup_.node)) {
  follower_ = std::thread([this] { follow(); });
  orders_ = std::thread([this] { order(); });
}

LyingBlocks::~LyingBlocks() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  changed_.notify_all();
  following_.TryCancel();
  follower_.join();
  orders_.join();
}

void LyingBlocks::begin() {
  const std::lock_guard lock(mutex_);
  if (!peer_ || began_ns_ != 0) return;
  peer_->set_tampering(setup_.lie);
  began_ns_ = monotonic_ns();
  changed_.notify_all();
}

nlohmann::json LyingBlocks::reported() const {
  const std::lock_guard lock(mutex_);
  return {{"began_ns", began_ns_}, {"served", served_}, {"tampered", tampered_}, {"ordered", ordered_}};
}

void LyingBlocks::follow() {
  const auto stream = stub_->Deliver(&following_);
  const auto seek = fabric::make_seek(setup_.keys.peer, "teleop", 0, realtime_ns(), crypto::random_bytes(24));
  if (!seek || !stream->Write(parsed<common::Envelope>(*seek))) return;
  protos::DeliverResponse response;
  while (stream->Read(&response) && response.has_block()) {
    auto block = std::make_shared<common::Block>(response.block());
    const std::lock_guard lock(mutex_);
    honest_.push_back(block->SerializeAsString());
    if (peer_) {
      peer_->add(monotonic_ns(), std::move(block));
    } else {
      peer_.emplace(std::move(block), setup_.seed, setup_.keys);
    }
    changed_.notify_all();
  }
}

void LyingBlocks::order() {
  const auto stub = gateway::Gateway::NewStub(setup_.node);
  while (wait()) {
    std::string envelope;
    {
      const std::lock_guard lock(mutex_);
      if (peer_) envelope = peer_->orders(monotonic_ns());
    }
    if (envelope.empty()) continue;
    gateway::SubmitRequest request;
    *request.mutable_prepared_transaction() = parsed<common::Envelope>(envelope);
    const auto payload = parsed<common::Payload>(request.prepared_transaction().payload());
    const auto header = parsed<common::ChannelHeader>(payload.header().channel_header());
    request.set_transaction_id(header.tx_id());
    request.set_channel_id(header.channel_id());
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(1));
    gateway::SubmitResponse response;
    const bool taken = stub->Submit(&context, request, &response).ok();
    const std::lock_guard lock(mutex_);
    if (taken) ++ordered_;
  }
}

/// False: it ends.
bool LyingBlocks::wait() {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, look_again);
  return !stopping_;
}

grpc::Status LyingBlocks::Deliver(grpc::ServerContext* context, Stream* client) {
  common::Envelope seek;
  if (!client->Read(&seek)) return grpc::Status::OK;
  const bool lied_to =
      setup_.lie != hil::PeerTampering::none && creator_of(parsed<common::Payload>(seek.payload())) == setup_.lied_to;
  return lied_to ? serve(*context, seek, *client) : hand_on(*context, seek, *client);
}

grpc::Status LyingBlocks::hand_on(grpc::ServerContext& context, const common::Envelope& seek, Stream& client) {
  const auto forward = grpc::ClientContext::FromServerContext(context);
  const auto node = stub_->Deliver(forward.get());
  protos::DeliverResponse response;
  if (!node->Write(seek)) return node->Finish();
  while (node->Read(&response)) {
    if (!client.Write(response)) {
      forward->TryCancel();
      break;
    }
  }
  return node->Finish();
}

bool LyingBlocks::send(Stream& client, const common::Block& block) {
  protos::DeliverResponse response;
  *response.mutable_block() = block;
  return client.Write(response);
}

grpc::Status LyingBlocks::serve(grpc::ServerContext& context, const common::Envelope& seek, Stream& client) {
  const auto asked = parsed<orderer::SeekInfo>(parsed<common::Payload>(seek.payload()).data());
  const bool alone = one_alone(asked);
  std::optional<std::uint64_t> next;
  if (asked.start().has_specified()) next = asked.start().specified().number();
  while (!context.IsCancelled()) {
    hil::ServingPeer::BlockPtr block;
    {
      const std::lock_guard lock(mutex_);
      if (stopping_) return grpc::Status::CANCELLED;
      if (peer_ && alone && next) {
        const auto fetched = peer_->fetch(*next);
        if (fetched) block = std::make_shared<common::Block>(*fetched);
      } else if (peer_) {
        block = next ? peer_->serve(monotonic_ns(), *next) : peer_->newest(monotonic_ns());
      }
      if (block && !next) next = block->header().number();
      if (block && began_ns_ != 0) {
        ++served_;
        if (*next >= honest_.size() || honest_[*next] != block->SerializeAsString()) ++tampered_;
      }
    }
    if (block) {
      if (!send(client, *block)) break;
      ++*next;
    }
    if (alone) {
      protos::DeliverResponse end;
      end.set_status(block ? common::SUCCESS : common::NOT_FOUND);
      (void)client.Write(end);
      return grpc::Status::OK;
    }
    if (!block) (void)wait();
  }
  return grpc::Status::CANCELLED;
}

}  // namespace ledgerline
