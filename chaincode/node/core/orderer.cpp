#include "chaincode/node/core/orderer.hpp"

#include <algorithm>

#include "common/base/printable.hpp"
#include "msp/identities.pb.h"

namespace ledgerline::node {
namespace {

/// The certificate of a SerializedIdentity is one whose time is over.
bool has_expired(const std::string& serialized, Now now) {
  msp::SerializedIdentity identity;
  if (!identity.ParseFromString(serialized)) return false;
  const auto certificate = crypto::parse_certificate(identity.id_bytes());
  return certificate && certificate->not_after_s < now.real_ns / ns_per_s;
}

Reply refuse_order(Code code, const std::string& status, const std::string& info) {
  return {code, info, "received unsuccessful response from orderer: status=" + status + ", info=" + info, {}};
}

}  // namespace

Reply Orderer::order(std::string_view bytes, Now now) {
  common::Envelope envelope;
  common::Payload payload;
  common::ChannelHeader channel_header;
  common::SignatureHeader signature_header;
  if (!envelope.ParseFromArray(bytes.data(), static_cast<int>(bytes.size())) ||
      !payload.ParseFromString(envelope.payload()) ||
      !channel_header.ParseFromString(payload.header().channel_header()) ||
      !signature_header.ParseFromString(payload.header().signature_header())) {
    return refuse_order(Code::invalid_argument, "BAD_REQUEST", "the envelope does not parse");
  }
  if (channel_header.channel_id() != config_.channel) {
    return refuse_order(Code::not_found, "BAD_REQUEST",
                        "channel " + printable(channel_header.channel_id(), max_name) + " not found");
  }
  if (channel_header.type() != common::ENDORSER_TRANSACTION) {
    return refuse_order(Code::invalid_argument, "BAD_REQUEST",
                        "header type " + std::to_string(channel_header.type()) + " is not served by this node");
  }
  const std::size_t size = envelope.payload().size() + envelope.signature().size();
  if (size > config_.max_envelope_bytes) {
    return refuse_order(Code::invalid_argument, "BAD_REQUEST",
                        "message payload is " + std::to_string(size) + " bytes and exceeds maximum allowed " +
                            std::to_string(config_.max_envelope_bytes) + " bytes");
  }
  const auto member = members_.check(signature_header.creator(), envelope.payload(), envelope.signature(), now);
  if (!member && has_expired(signature_header.creator(), now)) {
    return refuse_order(Code::invalid_argument, "BAD_REQUEST", "broadcast client identity expired");
  }
  if (!member) return refuse_order(Code::permission_denied, "FORBIDDEN", member.error().what);
  const bool heavy = !pending_.empty() && pending_bytes_ + bytes.size() > config_.max_waiting_bytes;
  if (pending_.size() >= config_.max_waiting || heavy) {
    return refuse_order(Code::unavailable, "SERVICE_UNAVAILABLE",
                        std::to_string(pending_.size()) + " envelopes wait for a block already");
  }
  pending_.push_back({std::string(bytes), now.monotonic_ns});
  pending_bytes_ += bytes.size();
  return {};
}

std::optional<TimeNs> Orderer::next_cut() const {
  if (pending_.empty()) return std::nullopt;
  const TimeNs oldest = pending_.front().arrived_ns;
  const bool full = pending_.size() >= config_.batch_count || pending_bytes_ >= config_.batch_bytes;
  return full ? oldest : oldest + config_.batch_timeout_ns;
}

std::vector<std::string> Orderer::take_batch() {
  std::vector<std::string> envelopes;
  std::size_t bytes = 0;
  while (!pending_.empty() && envelopes.size() < std::max<std::size_t>(config_.batch_count, 1)) {
    const std::size_t size = pending_.front().envelope.size();
    if (!envelopes.empty() && bytes + size > config_.batch_bytes) break;
    bytes += size;
    pending_bytes_ -= size;
    envelopes.push_back(std::move(pending_.front().envelope));
    pending_.pop_front();
  }
  return envelopes;
}

OrderedBlock Orderer::sign(common::Block block) const {
  const Status status = sign_block(block, identity_);
  return {std::move(block), status ? "" : status.error().what};
}

std::optional<OrderedBlock> Orderer::cut(Now now, const ChainEnd& end) {
  const auto due = next_cut();
  if (!due || *due > now.monotonic_ns) return std::nullopt;
  return sign(make_block(end, take_batch()));
}

OrderedBlock Orderer::genesis() const { return sign(make_block({}, {make_config_envelope(config_, identity_)})); }

}  // namespace ledgerline::node
