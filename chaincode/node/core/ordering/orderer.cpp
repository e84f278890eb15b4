#include "chaincode/node/core/ordering/orderer.hpp"

#include <algorithm>

#include "chaincode/node/core/tx/messages.hpp"
#include "common/base/check.hpp"
#include "common/base/text.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/msg/contract.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::node {
namespace {

/// The certificate of a SerializedIdentity is one whose time is over.
bool has_expired(const std::string& serialized, Now now) {
  const auto read = crypto::read_serialized(serialized);
  return read && read->certificate.not_after_s < now.real_ns / ns_per_s;
}

Reply refuse_order(Code code, const std::string& status, const std::string& info) {
  return {code, info, "received unsuccessful response from orderer: status=" + status + ", info=" + info, {}};
}

/// Whose share an envelope takes. Anybody may send the envelope of another member again, once it is in a block: what is
/// sent so takes one share for all, not its creator's.
crypto::IdentityName sent_again() { return {"", "sent again"}; }

}  // namespace

/// Commands, stops, and who may do what, as the sender says.
Urgency Orderer::claimed_urgency(const common::Payload& payload) const {
  constexpr std::size_t max_urgent_bytes = 64'000;
  protos::Transaction transaction;
  protos::ChaincodeActionPayload action;
  if (payload.data().size() > max_urgent_bytes || !transaction.ParseFromString(payload.data()) ||
      transaction.actions_size() != 1 || !action.ParseFromString(transaction.actions(0).payload())) {
    return Urgency::none;
  }
  const auto called = read_called(action.chaincode_proposal_payload());
  if (!called || called->contract != config_.contract || !contract::is_urgent(called->function)) return Urgency::none;
  return called->function == contract::stop ? Urgency::stop : Urgency::control;
}

/// Whether the first of its endorsements is one of a peer of the channel, of this proposal and no other one. One
/// signature is checked whatever comes, so that a flood of false ones costs no more than their creators' signatures do.
bool Orderer::is_endorsed(std::string_view envelope, Now now) const {
  const fabric::TransactionForm form = fabric::read_form(envelope);
  if (form.code != protos::VALID || form.endorsements.empty()) return false;
  const protos::Endorsement& first = form.endorsements.front();
  const auto peer = members_.check(first.endorser(), form.response_payload + first.endorser(), first.signature(), now);
  if (!peer || !(*peer)->peer) return false;
  return std::ranges::any_of(config_.organisations,
                             [&](const crypto::MspRoot& one) { return one.msp_id == (*peer)->name.msp_id; });
}

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
  if (!member) return refuse_order(Code::permission_denied, "FORBIDDEN", member.error().message);
  const std::string& tx_id = channel_header.tx_id();
  const bool again = is_committed_(tx_id);
  Sender sender{again ? sent_again() : (*member)->name, again ? Urgency::none : claimed_urgency(payload)};
  if (sender.urgency != Urgency::none &&
      (!is_endorsed(bytes, now) || !budget_.reserve(tx_id, sender.name, now.monotonic_ns))) {
    sender.urgency = Urgency::none;
  }
  if (nearly_full_ && sender.urgency == Urgency::none) {
    return refuse_order(Code::unavailable, "SERVICE_UNAVAILABLE",
                        "the disk is nearly full: commands, stops and control alone are ordered");
  }
  ordered_ns_ = now.monotonic_ns;
  auto why = sender.urgency == Urgency::none ? invalid_.refusal(sender.name, now.monotonic_ns) : std::nullopt;
  if (!why) why = waiting_.add(sender, std::string(bytes), now.monotonic_ns);
  if (why) {
    if (sender.urgency != Urgency::none) budget_.settle(tx_id, true);
    return refuse_order(Code::unavailable, "SERVICE_UNAVAILABLE", *why);
  }
  invalid_.ordered(tx_id, sender.name);
  return {};
}

std::optional<TimeNs> Orderer::next_cut() const {
  if (waiting_.empty()) return std::nullopt;
  const TimeNs oldest = waiting_.oldest_ns();
  const bool full = waiting_.count() >= config_.batch_count || waiting_.bytes() >= config_.batch_bytes;
  return full ? oldest : oldest + config_.batch_timeout_ns;
}

OrderedBlock Orderer::sign(common::Block block) const {
  const Status status = sign_block(block, identity_);
  return {std::move(block), status ? "" : status.error().message};
}

std::optional<OrderedBlock> Orderer::cut(Now now, const ChainEnd& end) {
  const auto due = next_cut();
  if (!due || *due > now.monotonic_ns) return std::nullopt;
  std::vector<std::string> envelopes = waiting_.pop(std::max<std::size_t>(config_.batch_count, 1), config_.batch_bytes);
  LEDGERLINE_CHECK(!envelopes.empty(), "a block that is due has a transaction", end.height);
  return sign(make_block(end, envelopes));
}

OrderedBlock Orderer::genesis() const { return sign(make_block({}, {make_config_envelope(config_, identity_)})); }

}  // namespace ledgerline::node
