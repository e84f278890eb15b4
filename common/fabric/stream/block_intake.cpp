#include "common/fabric/stream/block_intake.hpp"

#include <fmt/format.h>

#include "common/fabric/tx/decode.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {

Result<BlockIntake> BlockIntake::make(Setup setup) {
  BlockIntake intake(std::move(setup));
  if (intake.setup_.config_block.empty()) return intake;
  auto judge = BlockJudge::from(intake.setup_.config_block, intake.setup_.where.channel, intake.setup_.make_registry);
  if (!judge) return judge.error();
  intake.judge_ = std::move(*judge);
  intake.rules_.channel = intake.setup_.where.channel;
  intake.forget();
  return intake;
}

/// What has been followed does not hold on: blocks are missing.
void BlockIntake::forget() {
  if (!judge_) return;
  state_.emplace(KeyState::Part{.contract = setup_.where.contract, .likely_policy = setup_.likely_policy});
  defined_ = false;
  configure();
}

void BlockIntake::configure() {
  const ChannelConfig& config = judge_->channel_config();
  configured_ = config.block;
  members_ = judge_->make_members();
  rules_.foreign_events = !config.embedded_node;
  state_->configure(config);
  if (!config.embedded_node) return;
  state_->define(setup_.where.contract);
  defined_ = true;
}

void BlockIntake::define(const std::string& policy) {
  if (!misses_definition()) return;
  state_->hear(setup_.where.contract, policy);
  defined_ = true;
}

Result<Continuation> BlockIntake::continue_chain(const Believed& believed, const common::Block& newest,
                                                 const Fetch& fetch) {
  auto on = continue_behind(believed, newest, fetch);
  if (!on) return on;
  caught_up_ = false;
  if (on->gap) {
    if (const Status judged = judge_block(newest, fetch); !judged) return judged.error();
    forget();
  }
  chain_ = on->chain;
  next_ = chain_.height();
  return on;
}

Status BlockIntake::judge_block(const common::Block& message, const Fetch& fetch) {
  if (!judge_) return done;
  if (!std::exchange(caught_up_, true)) {
    if (auto caught_up = judge_->catch_up(message, fetch); !caught_up) return caught_up;
  }
  return judge_->judge(message);
}

Result<Block> BlockIntake::take(const common::Block& message, const Fetch& fetch) {
  auto block = decode_block(message);
  if (!block) return block;
  // Its place first: a configuration out of its turn, which the orderers have signed as well, is not to be followed.
  if (next_ && block->number != *next_)
    return Error{fmt::format("block {} came where {} was due", block->number, *next_)};
  ChainCheck chain = chain_;
  if (Status follows = chain.add(*block); !follows) return follows.error();
  if (Status judged = judge_block(message, fetch); !judged) return judged.error();
  if (setup_.compare) {
    if (std::string problem = setup_.compare(block->number, chain.hash()); !problem.empty()) return Error{problem};
  }
  chain_ = std::move(chain);
  next_ = chain_.height();
  if (state_) judge_transactions(message, *block);
  return block;
}

void BlockIntake::judge_transactions(const common::Block& message, Block& block) {
  if (judge_->config() != configured_ && judge_->config() != block.number) configure();
  // Nobody orders the first block.
  if (block.number == 0) return;
  const std::vector<Verdict> verdicts = fabric::judge_transactions(message, *state_, *members_, rules_);
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const Verdict& verdict = verdicts[i];
    Transaction& transaction = block.transactions[i];
    if (verdict.config) continue;
    if (verdict.by_flag) {
      ++counts_.by_flag;
    } else {
      ++counts_.judged;
    }
    const bool told_again = transaction.code == protos::DUPLICATE_TXID && verdict.code != protos::DUPLICATE_TXID;
    transaction.by_flag = verdict.by_flag || told_again;
    transaction.creator_fits = verdict.creator_signed;
    for (std::size_t e = 0; e < verdict.endorsement_fits.size() && e < transaction.endorsements.size(); ++e)
      transaction.endorsements[e].fits = verdict.endorsement_fits[e];
    if (transaction.code == code_unbelievable) continue;
    // Of what is invalid in any case the reason makes no difference.
    const bool valid = verdict.code == protos::VALID;
    if (transaction.code >= 0 && valid == (transaction.code == protos::VALID)) continue;
    ++counts_.differ;
    if (transaction.code == protos::VALID) {
      const bool again = verdict.code == protos::DUPLICATE_TXID;
      transaction.code = again ? protos::DUPLICATE_TXID : code_unbelievable;
      transaction.problem = verdict.why;
    } else if (transaction.code < 0) {
      transaction.problem = "the peer does not say whether it is";
    } else {
      transaction.problem = "it is valid";
    }
  }
  state_->apply(block.number, verdicts);
  if (judge_->config() != configured_) configure();
}

}  // namespace ledgerline::fabric
