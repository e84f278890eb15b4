#pragma once
#include <atomic>
#include <memory>
#include <string>

namespace ledgerline::node {

/// How many calls of one service may be open at once: each costs memory and a turn of the core. Any thread.
class Limit {
 public:
  using Slot = std::shared_ptr<void>;

  /// `service`: its name, for the refusal.
  Limit(std::string service, int max_open) : service_(std::move(service)), max_open_(max_open) {}

  /// Held until the last copy is gone; nullptr when all are taken. The limit outlives its places.
  Slot take() {
    if (open_.fetch_add(1) < max_open_) return {this, [this](void*) { --open_; }};
    --open_;
    return nullptr;
  }
  /// In Fabric's words.
  std::string refusal() const {
    return "too many requests for " + service_ + ", exceeding concurrency limit (" + std::to_string(max_open_) + ")";
  }

 private:
  const std::string service_;
  const int max_open_;
  std::atomic<int> open_{0};
};

}  // namespace ledgerline::node
