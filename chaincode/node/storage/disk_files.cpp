#include <fcntl.h>
#include <linux/magic.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include "chaincode/node/storage/files.hpp"

namespace ledgerline::node {
namespace {

Error failed(const std::string& what, const std::string& path) {
  return Error{what + " " + path + ": " + std::strerror(errno)};
}

/// A file descriptor, closed at the end.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

class DiskFile final : public File {
 public:
  DiskFile(std::string path, Descriptor fd) : path_(std::move(path)), fd_(std::move(fd)) {}

  Status append(std::string_view bytes) override {
    full_ = false;
    while (!bytes.empty()) {
      const ssize_t written = ::write(fd_.get(), bytes.data(), bytes.size());
      if (written < 0 && errno == EINTR) continue;
      full_ = written < 0 && (errno == ENOSPC || errno == EDQUOT);
      if (written < 0) return failed("writing", path_);
      bytes.remove_prefix(static_cast<std::size_t>(written));
    }
    return done;
  }

  bool full() const override { return full_; }

  Status sync() override {
    if (::fdatasync(fd_.get()) != 0) return failed("syncing", path_);
    return done;
  }

  Result<std::string> read(std::uint64_t offset, std::size_t size) const override {
    std::string bytes(size, '\0');
    for (std::size_t got = 0; got < size;) {
      const ssize_t more = ::pread(fd_.get(), bytes.data() + got, size - got, static_cast<off_t>(offset + got));
      if (more < 0 && errno == EINTR) continue;
      if (more < 0) return failed("reading", path_);
      if (more == 0) return Error{path_ + " ends before byte " + std::to_string(offset + size)};
      got += static_cast<std::size_t>(more);
    }
    return bytes;
  }

  Result<std::uint64_t> size() const override {
    struct stat info {};
    if (::fstat(fd_.get(), &info) != 0) return failed("looking at", path_);
    return static_cast<std::uint64_t>(info.st_size);
  }

  Status truncate(std::uint64_t size) override {
    if (::ftruncate(fd_.get(), static_cast<off_t>(size)) != 0) return failed("cutting", path_);
    return done;
  }

 private:
  std::string path_;
  Descriptor fd_;
  bool full_ = false;
};

class Directory final : public Files {
 public:
  Directory(std::string path, Descriptor directory, Descriptor lock)
      : path_(std::move(path)), directory_(std::move(directory)), lock_(std::move(lock)) {}

  Result<std::unique_ptr<File>> open(const std::string& name) override {
    const std::string path = path_ + "/" + name;
    Descriptor fd(::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0600));
    if (fd.get() < 0) return failed("opening", path);
    if (Status status = sync_names(); !status) return status.error();
    return std::unique_ptr<File>(std::make_unique<DiskFile>(path, std::move(fd)));
  }

  std::string place() const override { return path_; }

 private:
  /// A new name survives only when its directory is synced too.
  Status sync_names() const {
    if (::fsync(directory_.get()) != 0) return failed("syncing", path_);
    return done;
  }

  std::string path_;
  Descriptor directory_, lock_;
};

}  // namespace

Result<std::unique_ptr<Files>> open_directory(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) return Error{"making " + path + ": " + error.message()};
  Descriptor directory(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory.get() < 0) return failed("opening", path);
  struct stat info {};
  if (::fstat(directory.get(), &info) != 0) return failed("looking at", path);
  // Also root: what it makes here the owner could not read any more.
  if (info.st_uid != ::geteuid()) {
    return Error{path + " belongs to user " + std::to_string(info.st_uid) + ", and this is user " +
                 std::to_string(::geteuid()) + ": run as its owner, or give a directory of your own"};
  }
  const std::string lock_path = path + "/lock";
  Descriptor lock(::open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600));
  if (lock.get() < 0) return failed("opening", lock_path);
  if (::flock(lock.get(), LOCK_EX | LOCK_NB) != 0) {
    if (errno == EWOULDBLOCK) return Error{path + " is in use by another ledgerline-node; give each its own directory"};
    return failed("locking", lock_path);
  }
  return std::unique_ptr<Files>(std::make_unique<Directory>(path, std::move(directory), std::move(lock)));
}

Result<std::string> storage_kind(const std::string& path) {
  struct statfs info {};
  if (::statfs(path.c_str(), &info) != 0) return failed("looking at", path);
  return std::string(info.f_type == TMPFS_MAGIC || info.f_type == RAMFS_MAGIC ? "tmpfs" : "disk");
}

}  // namespace ledgerline::node
