#include "common/fabric/blocks/block_subscription.hpp"

#include <utility>

#include "common/base/log.hpp"

namespace ledgerline::fabric {
namespace {

using OnConnection = std::function<void(bool connected, const std::string& why)>;

OnConnection logged(std::string stream, OnConnection then) {
  return [stream = std::move(stream), words = ConnectionLog(), then = std::move(then)](bool connected,
                                                                                       const std::string& why) mutable {
    if (const auto word = words.line(connected, why, monotonic_ns()); word && connected) {
      spdlog::info("{} {}", stream, *word);
    } else if (word) {
      spdlog::warn("{}: {}", stream, *word);
    }
    if (then) then(connected, why);
  };
}

}  // namespace

Result<StoredCheckpoint> StoredCheckpoint::read(const std::string& path, const std::string& channel) {
  auto last = read_checkpoint(path, channel);
  if (!last) return last.error();
  return StoredCheckpoint{path, channel, std::move(*last)};
}

BlockSubscription::BlockSubscription(Config config) : config_(std::move(config)) {
  if (config_.kept.path.empty()) return;
  writer_ = std::make_unique<CheckpointWriter>(config_.kept.path, [label = config_.label](const std::string& why) {
    spdlog::error("{}the checkpoint is not kept: {}", label, why);
  });
}

void BlockSubscription::open(Client& client, Client::StreamHandlers handlers) {
  const std::string& label = config_.label;
  handlers.on_connection = logged(
      label + "block stream", [this, then = std::move(handlers.on_connection)](bool connected, const std::string& why) {
        {
          const std::lock_guard lock(mutex_);
          connection_ = connected ? Status(done) : Error{why.empty() ? "no answer yet" : why};
        }
        if (then) then(connected, why);
      });
  handlers.on_orderers = logged(label + "orderer's block stream", std::move(handlers.on_orderers));
  if (!handlers.on_unverified)
    handlers.on_unverified = [&label](const std::string& what) { spdlog::warn("{}{}", label, what); };
  if (!handlers.on_contradiction)
    handlers.on_contradiction = [&label, last = std::string()](const std::string& what) mutable {
      if (std::exchange(last, what) != what)
        spdlog::error("{}the ledger's blocks contradict what is known: {}", label, what);
    };
  const bool keeps_each = writer_ && !config_.program_stores;
  if (keeps_each)
    handlers.on_block = [this, then = std::move(handlers.on_block)](const Block& block, std::string_view raw) {
      if (then) then(block, raw);
      if (block.confirmed)
        store(block.number, block_header_hash(block.number, block.previous_hash, block.data_hash), {});
    };
  handlers.on_confirmed = [this, keeps_each, then = std::move(handlers.on_confirmed)](const auto& confirmed) {
    {
      const std::lock_guard lock(mutex_);
      confirmed_after_.add(confirmed.confirmed_ns - confirmed.ordered_ns);
    }
    if (then) then(confirmed);
    if (keeps_each) store(confirmed.number, confirmed.hash, {});
  };
  handlers.on_continued = [this, keeps_each, then = std::move(handlers.on_continued)](const Continuation& how) {
    if (how.gap)
      spdlog::warn("{}blocks {} to {} came while this program was away, and are not read", config_.label,
                   how.verified + 1, how.newest);
    // Validated already; a program that ends before the next block must not forget it.
    if (how.gap && keeps_each) store(how.newest, how.chain.hash(), {});
    if (then) then(how);
  };
  if (auto last = std::exchange(config_.kept.last, std::nullopt)) {
    stream_ = client.blocks_behind({std::move(*last), config_.max_absence_blocks}, std::move(handlers));
    return;
  }
  if (writer_ && !config_.first)
    spdlog::warn("{}there is no checkpoint yet: this start trusts the chain that the peer serves", label);
  stream_ = client.blocks(config_.first, std::move(handlers));
}

void BlockSubscription::store(std::uint64_t number, std::string hash, std::string records) {
  if (writer_) writer_->store({config_.kept.channel, number, std::move(hash), std::move(records)});
}

Status BlockSubscription::connection() const {
  const std::lock_guard lock(mutex_);
  return connection_;
}

Quantiles BlockSubscription::confirmed_after_ms() const {
  const std::lock_guard lock(mutex_);
  return confirmed_after_.quantiles_ms();
}

}  // namespace ledgerline::fabric
