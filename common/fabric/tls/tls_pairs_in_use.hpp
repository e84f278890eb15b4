#pragma once
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

namespace ledgerline::fabric {

/// The TLS pairs of a program's clients that were renewed while it runs, as they were checked: what lies in the files
/// may be something else by then. Any thread.
class TlsPairsInUse {
 public:
  struct Pair {
    std::string certificate_pem, key_pem;
  };

  /// Of the pair whose certificate is in that file. Connections are recreated after it.
  void renew(const std::string& certificate_file, Pair pair) {
    const std::lock_guard lock(mutex_);
    pairs_[certificate_file] = std::move(pair);
    ++renewals_;
  }
  /// None: it was not renewed, so its files count.
  std::optional<Pair> of(const std::string& certificate_file) const {
    const std::lock_guard lock(mutex_);
    const auto found = pairs_.find(certificate_file);
    return found == pairs_.end() ? std::nullopt : std::optional(found->second);
  }
  std::uint64_t renewals() const {
    const std::lock_guard lock(mutex_);
    return renewals_;
  }

 private:
  mutable std::mutex mutex_;
  std::map<std::string, Pair> pairs_;  ///< at most one for each pair that a config names
  std::uint64_t renewals_ = 0;
};

}  // namespace ledgerline::fabric
