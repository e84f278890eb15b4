#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"

/// The little that the ledger's storage needs of a file system, so that tests can take the disk's place and lose what
/// was never synced.
namespace ledgerline::node {

/// Errors name the file. append and sync from one thread; read from any.
class File {
 public:
  virtual ~File() = default;
  virtual Status append(std::string_view bytes) = 0;
  /// Whether the last append failed since there is no room; a part of it may be there.
  virtual bool full() const { return false; }
  /// Returns when everything appended so far survives a loss of power.
  virtual Status sync() = 0;
  /// Exactly `size` bytes, or an error.
  virtual Result<std::string> read(std::uint64_t offset, std::size_t size) const = 0;
  virtual Result<std::uint64_t> size() const = 0;
  virtual Status truncate(std::uint64_t size) = 0;
};

class Files {
 public:
  virtual ~Files() = default;
  /// Made when it is missing.
  virtual Result<std::unique_ptr<File>> open(const std::string& name) = 0;
  /// For messages: where the files are.
  virtual std::string place() const = 0;
};

/// A directory on disk, made when it is missing. Held by one process at a time, and only by its owner's: others get an
/// error that says so.
Result<std::unique_ptr<Files>> open_directory(const std::string& path);

/// "disk" or "tmpfs": on the latter a loss of power loses all, and latencies are not those of a disk.
Result<std::string> storage_kind(const std::string& path);

/// In memory. Shared by copies, so that a test can "restart"; cut_power() drops what was not synced. One thread.
class MemoryFiles final : public Files {
 public:
  struct Content {
    std::string bytes;
    std::size_t synced = 0;
    std::size_t room = SIZE_MAX;  ///< bytes that it may have
  };
  Result<std::unique_ptr<File>> open(const std::string& name) override;
  std::string place() const override { return "memory"; }

  void cut_power();
  Content& content(const std::string& name) { return *(*contents_)[name]; }

 private:
  using Contents = std::map<std::string, std::shared_ptr<Content>>;
  std::shared_ptr<Contents> contents_ = std::make_shared<Contents>();
};

}  // namespace ledgerline::node
