#pragma once
#include <algorithm>
#include <cstddef>
#include <deque>
#include <memory>
#include <mutex>

namespace ledgerline::node {

/// Streams of which no member is known yet, and from which nothing has come that somebody looks at: whoever opened them may
/// be anybody. One too many ends the oldest, so that they take no place of members', and a member, who says at once who it
/// is, always finds one. Any thread.
class Strangers {
 public:
  class Stream {
   public:
    virtual ~Stream() = default;
    /// Ends it, for another one's sake.
    virtual void displace() = 0;
  };

  explicit Strangers(std::size_t max_streams) : max_streams_(max_streams) {}

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
