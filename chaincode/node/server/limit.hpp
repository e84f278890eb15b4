#pragma once
#include <atomic>
#include <cstddef>
#include <deque>
#include <memory>
#include <mutex>
#include <string>

namespace ledgerline::node {

/// How many calls of one service may be open at once: each costs memory and a turn of the core. Any thread.
class Limit {
 public:
  using Slot = std::shared_ptr<void>;

  /// `service`: its name, for the refusal.
  Limit(std::string service, int max_open) : service_(std::move(service)), max_open_(max_open) {}

  /// Held until the last copy is gone; nullptr when all are taken. A place may outlive the limit: whatever thread has a
  /// stream last ends it.
  Slot acquire() {
    if (open_->fetch_add(1) < max_open_) return {open_.get(), [open = open_](void*) { --*open; }};
    --*open_;
    return nullptr;
  }
  /// In Fabric's words.
  std::string refusal() const {
    return "too many requests for " + service_ + ", exceeding concurrency limit (" + std::to_string(max_open_) + ")";
  }

 private:
  const std::string service_;
  const int max_open_;
  const std::shared_ptr<std::atomic<int>> open_ = std::make_shared<std::atomic<int>>(0);
};

/// Streams of which no member is known yet, and from which nothing has come that somebody looks at: anybody may have
/// opened them. One too many ends the oldest, so that they take no slot from members. A member, who identifies itself
/// at once, always finds a slot. Any thread.
class UnauthenticatedStreams {
 public:
  class Stream {
   public:
    virtual ~Stream() = default;
    /// Ends it, for another one's sake.
    virtual void displace() = 0;
  };

  explicit UnauthenticatedStreams(std::size_t max_streams) : max_streams_(max_streams) {}

  void add(const std::shared_ptr<Stream>& stream) {
    std::shared_ptr<Stream> oldest;
    {
      const std::lock_guard lock(mutex_);
      streams_.push_back(stream);
      if (streams_.size() <= max_streams_) return;
      oldest = streams_.front().lock();
      streams_.pop_front();
    }
    if (oldest) oldest->displace();
  }
  void remove(const Stream* stream) {
    const std::lock_guard lock(mutex_);
    std::erase_if(streams_, [&](const std::weak_ptr<Stream>& one) {
      const auto there = one.lock();
      return !there || there.get() == stream;
    });
  }

 private:
  const std::size_t max_streams_;
  std::mutex mutex_;
  std::deque<std::weak_ptr<Stream>> streams_;
};

}  // namespace ledgerline::node
