#include "tests/unit/chaincode/endorser/machine.hpp"

namespace ledgerline::endorser {

void Machine::start(const Member& as) {
  identity_ = &as;
  core_ = std::make_unique<EndorserCore>(
      EndorserCore::Setup{{}, as.identity, fabric::BlockValidator::registry_of(library)});
  validator_ = *fabric::BlockValidator::from(channel_.blocks.front(), "teleop", library);
  readiness_ = {};
  checks_.clear();
  why_.clear();
}

bool Machine::show(const std::string& raw) {
  common::Block message;
  message.ParseFromString(raw);
  Status status = validator_->validate(message);
  const auto block = fabric::decode_block(raw);
  if (status && !block) status = block.error();
  if (status) status = core_->apply(*block, raw);
  if (status) return true;
  readiness_.fail();
  why_ = status.error().message;
  return false;
}

void Machine::step(std::uint64_t behind, node::Now now) {
  if (!runs() || readiness_.failed() || !readiness_.connected()) return;
  const std::uint64_t there = channel_.blocks.size();
  while (core_->height() + behind < there && show(channel_.blocks[core_->height()])) {
  }
  if (readiness_.needs_height()) readiness_.set_peer_height(readiness_.connection(), channel_.peer.height());
  check(now);
}

void Machine::check(node::Now now) {
  if (readiness_.failed() || checks_.empty()) return;
  Check one = std::move(checks_.front());
  checks_.pop_front();
  if (one.tried > 0) {
    node::Reply reply = core_->process_proposal(one.signed_proposal, now);
    if (reply.code != node::Code::ok) return;
    one.answer = std::move(reply.bytes);
    one.defined_at = core_->defined_at();
  }
  const node::Reply peers = channel_.peer.process_proposal(one.signed_proposal, now);
  if (peers.code != node::Code::ok) return;
  const Comparison found = compare_answers(one.answer, peers.bytes);
  if (found == Comparison::other_state && ++one.tried < max_tries) {
    checks_.push_front(std::move(one));
    return;
  }
  const Status agrees = readiness_.record_comparison(found, one.defined_at, core_->defined_at());
  why_ = agrees ? "" : agrees.error().message;
  if (!agrees) readiness_.fail();
}

node::Reply Machine::process_proposal(const std::string& signed_proposal, node::Now now) {
  const node::Reply away{node::Code::unavailable, "away", "away", {}};
  if (!runs() || !readiness_.check(core_->height())) return away;
  node::Reply reply = core_->process_proposal(signed_proposal, now);
  if (reply.code == node::Code::unavailable) return reply;
  const bool agreed = readiness_.has_agreed(core_->defined_at());
  if (reply.code == node::Code::ok && checks_.size() < max_checks && (!agreed || random_.next() % check_one_in == 0))
    checks_.push_back({signed_proposal, reply.bytes, core_->defined_at()});
  return agreed ? reply : away;
}

}  // namespace ledgerline::endorser
