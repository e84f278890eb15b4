#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace ledgerline {

/// Sees that files have been replaced or written, by one stat of each a look. A change counts when the files are the
/// same from one look to the next, since certificate and key are two. One thread.
class ChangedFiles {
 public:
  /// True once for each change, and once at first: for what has been read before that may be old already.
  bool look(const std::vector<std::string>& files);
  /// What lies there now has been read.
  void taken(const std::vector<std::string>& files) { taken_ = seen_ = stamps(files); }

 private:
  struct Stamp {
    std::string file;
    std::uint64_t device = 0, inode = 0, size = 0;  ///< all 0: it is not there
    std::int64_t changed_ns = 0;
    bool operator==(const Stamp&) const = default;
  };
  static std::vector<Stamp> stamps(const std::vector<std::string>& files);

  std::vector<Stamp> taken_, seen_;
};

}  // namespace ledgerline
