#include "chaincode/node/shell/block_feed.hpp"

namespace ledgerline::node {

std::uint64_t BlockFeed::height() const {
  const std::lock_guard lock(mutex_);
  return height_;
}

Result<BlockFeed::Bytes> BlockFeed::read(std::uint64_t number) const {
  {
    const std::lock_guard lock(mutex_);
    if (number >= height_) return Error{"there is no block " + std::to_string(number)};
    const std::uint64_t age = height_ - number;
    if (age <= recent_.size()) return recent_[recent_.size() - age];
  }
  auto bytes = store_.read(number);
  if (!bytes) return bytes.error();
  return std::make_shared<const std::string>(std::move(*bytes));
}

bool BlockFeed::wait(std::uint64_t number, std::weak_ptr<Waiter> waiter) {
  const std::lock_guard lock(mutex_);
  if (number < height_) return false;
  // A reader may wait for a block far ahead: it is woken by each one and waits again.
  if (waiters_.size() >= prune_at_) {
    std::erase_if(waiters_, [](const auto& known) { return known.expired(); });
    prune_at_ = std::max<std::size_t>(64, 2 * waiters_.size());
  }
  waiters_.push_back(std::move(waiter));
  return true;
}

void BlockFeed::wake_soon(std::weak_ptr<Waiter> waiter) {
  {
    const std::lock_guard lock(mutex_);
    waiters_.push_back(std::move(waiter));
    news_ = true;
  }
  published_.notify_one();
}

void BlockFeed::publish(std::uint64_t number, std::string bytes) {
  {
    const std::lock_guard lock(mutex_);
    height_ = number + 1;
    recent_.push_back(std::make_shared<const std::string>(std::move(bytes)));
    if (recent_.size() > recent_blocks) recent_.pop_front();
    news_ = true;
  }
  published_.notify_one();
}

void BlockFeed::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    published_.wait(lock, [&] { return news_ || ended_; });
    if (ended_) return;
    news_ = false;
    const auto woken = std::exchange(waiters_, {});
    lock.unlock();
    for (const auto& weak : woken) {
      if (const auto waiter = weak.lock()) waiter->wake();
    }
    lock.lock();
  }
}

BlockFeed::~BlockFeed() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  published_.notify_one();
  thread_.join();
}

void BlockFeed::start_at(std::uint64_t height) {
  const std::lock_guard lock(mutex_);
  height_ = height;
}

}  // namespace ledgerline::node
