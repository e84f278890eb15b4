#include "common/fabric/client/commits.hpp"

#include <utility>

namespace ledgerline::fabric {

void Commits::on_news(std::function<void()> wake) {
  const std::lock_guard lock(mutex_);
  wake_ = std::move(wake);
}

bool Commits::await(const std::string& tx_id) {
  const std::lock_guard lock(mutex_);
  if (streams_ == 0) return false;
  awaited_.insert(tx_id);
  return true;
}

void Commits::forget(const std::string& tx_id) {
  const std::lock_guard lock(mutex_);
  awaited_.erase(tx_id);
}

Commits::Update Commits::take() {
  const std::lock_guard lock(mutex_);
  return std::exchange(news_, {});
}

void Commits::connected(bool is) {
  const std::lock_guard lock(mutex_);
  streams_ += is ? 1 : -1;
  if (streams_ > 0 || awaited_.empty()) return;
  news_.lost = true;
  if (wake_) wake_();
}

void Commits::block(const Block& block) {
  const std::lock_guard lock(mutex_);
  bool some = false;
  for (const Transaction& tx : block.transactions) {
    if (awaited_.erase(tx.tx_id) == 0) continue;
    news_.seen.push_back({tx.tx_id, block.number, tx.code});
    some = true;
  }
  if (some && wake_) wake_();
}

}  // namespace ledgerline::fabric
