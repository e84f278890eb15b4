#pragma once
#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "common/fabric/client/client.hpp"

namespace ledgerline::fabric {

using Numbers = std::vector<std::uint64_t>;

/// What comes of a stream of blocks, to be waited for. It outlives the stream.
class StreamWatch {
 protected:
  Client::StreamHandlers handlers() {
    Client::StreamHandlers handlers;
    handlers.on_block = [this](const Block& block, std::string_view) {
      say([&] { numbers_.push_back(block.number); });
    };
    handlers.on_connection = [this](bool connected, const std::string& why) {
      say([&] { connected ? void(connected_ = true) : problems_.push_back(why); });
    };
    return handlers;
  }
  void say(const std::function<void()>& what) {
    const std::lock_guard lock(mutex_);
    what();
    changed_.notify_all();
  }
  void await(const std::function<bool()>& there) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, there);  // ctest has a limit
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  Numbers numbers_;  ///< of the blocks
  std::vector<std::string> problems_;
  bool connected_ = false;
};

}  // namespace ledgerline::fabric
