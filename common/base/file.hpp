#pragma once
#include <sys/stat.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline {

/// Reads a whole file; an error names it.
Result<std::string> read_file(const std::string& path);
/// Rewrites a file, and creates its parent folders; a regular file has its `mode` before it has content. Not synced.
Status write_file(const std::string& path, std::string_view content, int mode = 0644);
/// The same, whole or not at all whatever dies meanwhile, and on the disk when it returns. `path`.new is its own.
Status replace_file(const std::string& path, std::string_view content, int mode = 0644);

/// Whether a secret's file is for whom it is meant alone: its mode is 0600 or less, or it is root's own with reading,
/// and no more, for a group of ours (0440, 0640: a Kubernetes secret with fsGroup). `own_groups`: of this process.
bool is_private(unsigned mode, unsigned owner, unsigned group, const std::vector<unsigned>& own_groups);
/// The same of a file as stat() reports it, for this process.
bool is_private(const struct stat& file);

/// From now on this process leaves no core dump, and no other process of its user may read its memory. Call it before
/// reading a secret. The process' files in /proc then belong to root.
void keep_memory_private() noexcept;

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

/// Bytes that the files below `directory` occupy, in whole blocks of their file system. Files that vanish meanwhile and
/// a missing directory count as zero.
std::uint64_t bytes_below(const std::string& directory);

/// The file system's where `path` is, or would be made.
Result<std::filesystem::space_info> space_at(const std::string& path);

/// An error where the folder that this file would be made in is not there.
Status check_folder_of(const std::string& file);

/// An error that names the path and both sizes when fewer bytes are free there than needed.
Status check_space(const std::string& path, std::uint64_t needed, const std::string& for_what);

}  // namespace ledgerline
