#pragma once
#include <cstdint>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline {

/// A folder in which nobody else decides what is read: it, the folders above it and its files belong to this user or to
/// root, and others may write none of them. (Folders above it may be as /tmp is, where only owners remove.) What was
/// checked is what is read: by descriptors, never by name again.
class OwnedFolder {
 public:
  /// Links on the way are followed, and what they lead to is checked.
  static Result<OwnedFolder> open(const std::string& path);
  OwnedFolder(OwnedFolder&& other) noexcept;
  OwnedFolder& operator=(OwnedFolder&&) = delete;
  ~OwnedFolder();

  /// A plain file in it, no link, of at most so many bytes.
  Result<std::string> read(const std::string& name, std::int64_t max_bytes) const;

 private:
  OwnedFolder(std::string path, int fd) : path_(std::move(path)), fd_(fd) {}
  std::string path_;
  int fd_;
};

}  // namespace ledgerline
