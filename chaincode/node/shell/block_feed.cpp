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
  const std::lock_guard lock(mutex_);
  waiters_.push_back(std::move(waiter));
  news_ = true;
}

void BlockFeed::publish(std::uint64_t number, std::string bytes, std::set<std::string> writers) {
  const std::lock_guard lock(mutex_);
  height_ = number + 1;
  writers_ = std::move(writers);
  recent_.push_back(std::make_shared<const std::string>(std::move(bytes)));
  if (recent_.size() > recent_blocks) recent_.pop_front();
  news_ = true;
}

bool BlockFeed::has_news() const {
  const std::lock_guard lock(mutex_);
  return news_ && !waiters_.empty();
}

void BlockFeed::wake_readers() {
  std::vector<std::weak_ptr<Waiter>> woken;
  std::set<std::string> writers;
  {
    const std::lock_guard lock(mutex_);
    news_ = false;
    woken.swap(waiters_);
    writers = writers_;
  }
  std::vector<std::shared_ptr<Waiter>> last;
  for (const auto& weak : woken) {
    auto waiter = weak.lock();
    if (!waiter) continue;
    if (writers.contains(waiter->organisation()))
      last.push_back(std::move(waiter));
    else
      waiter->wake();
  }
  for (const auto& waiter : last) waiter->wake();
}

void BlockFeed::start_at(std::uint64_t height) {
  const std::lock_guard lock(mutex_);
  height_ = height;
}

}  // namespace ledgerline::node
