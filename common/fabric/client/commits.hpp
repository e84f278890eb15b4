#pragma once
#include <functional>
#include <mutex>
#include <string>
#include <unordered_set>
#include <vector>

#include "common/fabric/tx/transaction.hpp"

namespace ledgerline::fabric {

/// Between a client's block streams, which see transactions committed, and its pipeline, which waits for some of them.
/// Any thread; the streams may outlive the pipeline.
class Commits {
 public:
  struct Observation {
    std::string tx_id;
    std::uint64_t block = 0;
    int code = 0;
  };

  // The pipeline's side.

  /// `wake` comes on a stream's thread when there is something to take(); an empty one ends that.
  void on_news(std::function<void()> wake);
  /// Whether a stream is there that would see it. False: ask the peer.
  bool await(const std::string& tx_id);
  void forget(const std::string& tx_id);
  /// What was seen of the awaited; each once. `lost`: no stream is left, so what is still awaited has to be asked for.
  struct Update {
    std::vector<Observation> seen;
    bool lost = false;
  };
  Update take();

  // A stream's side.

  void connected(bool is);
  void block(const Block& block);

 private:
  std::mutex mutex_;  ///< held while `wake` is called
  std::function<void()> wake_;
  std::unordered_set<std::string> awaited_;
  Update news_;
  int streams_ = 0;
};

}  // namespace ledgerline::fabric
