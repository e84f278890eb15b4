#pragma once
#include <cstdint>
#include <map>
#include <mutex>
#include <string>

namespace ledgerline::fabric {

/// Compares the headers of one chain as two sources tell it, so that a peer that shows its clients another chain than
/// was ordered is found out. Neither source waits for the other: headers that only one has told yet are kept, the
/// newest `max_kept` of them. Any thread.
class CrossCheck {
 public:
  enum class Source { peer, orderer };
  static constexpr std::size_t max_kept = 1024;

  /// `hash`: block_header_hash. Returns what is wrong, for good once something was; empty: nothing.
  std::string add(Source source, std::uint64_t number, const std::string& hash);
  std::uint64_t compared() const;

 private:
  mutable std::mutex mutex_;
  std::map<std::uint64_t, std::string> told_[2];
  std::uint64_t compared_ = 0;
  std::string problem_;
};

}  // namespace ledgerline::fabric
