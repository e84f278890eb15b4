#include "common/base/files/owned_folder.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

namespace ledgerline {
namespace {

constexpr mode_t written_by_others = S_IWGRP | S_IWOTH;

/// Of what is open: whether others decide what is in it.
Status check(const std::string& path, const struct stat& info, mode_t kind, bool is_above) {
  if ((info.st_mode & S_IFMT) != kind)
    return Error{fmt::format("{}: there is no such {}", path, kind == S_IFDIR ? "folder" : "file")};
  if (info.st_uid != ::geteuid() && info.st_uid != 0)
    return Error{fmt::format("{} belongs to neither this user nor root, and what is in it decides; run: chown {} {}",
                             path, ::geteuid(), path)};
  const bool only_owners_remove = is_above && (info.st_mode & S_ISVTX) != 0;
  if ((info.st_mode & written_by_others) != 0 && !only_owners_remove)
    return Error{fmt::format("{}: others than its owner may write it, and what is in it decides; run: chmod go-w {}",
                             path, path)};
  return done;
}

}  // namespace

Result<OwnedFolder> OwnedFolder::open(const std::string& path) {
  std::error_code error;
  const std::filesystem::path real = std::filesystem::canonical(path, error);
  if (error) return Error{fmt::format("{}: there is no such folder", path)};
  OwnedFolder folder("/", ::open("/", O_PATH | O_DIRECTORY | O_CLOEXEC));
  for (auto step = std::next(real.begin()); true; ++step) {
    struct stat info {};
    if (folder.fd_ < 0 || ::fstat(folder.fd_, &info) != 0)
      return Error{fmt::format("{}: {}", folder.path_, std::strerror(errno))};
    if (auto status = check(folder.path_, info, S_IFDIR, step != real.end()); !status) return status.error();
    if (step == real.end()) return folder;
    const int next = ::openat(folder.fd_, step->c_str(), O_PATH | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    const int why = errno;
    ::close(std::exchange(folder.fd_, next));
    folder.path_ = (std::filesystem::path(folder.path_) / *step).string();
    errno = why;
  }
}

OwnedFolder::OwnedFolder(OwnedFolder&& other) noexcept
    : path_(std::move(other.path_)), fd_(std::exchange(other.fd_, -1)) {}

OwnedFolder::~OwnedFolder() {
  if (fd_ >= 0) ::close(fd_);
}

Result<std::string> OwnedFolder::read(const std::string& name, std::int64_t max_bytes) const {
  const std::string path = path_ + "/" + name;
  const int fd = ::openat(fd_, name.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0)
    return Error{errno == ENOENT ? fmt::format("{}: there is no such file", path)
                                 : fmt::format("{}: {}", path, std::strerror(errno))};
  struct stat info {};
  Status status =
      ::fstat(fd, &info) == 0 ? check(path, info, S_IFREG, false) : Status(Error{path + ": " + std::strerror(errno)});
  if (status && info.st_size > max_bytes)
    status = Error{fmt::format("{}: it has {} bytes, and at most {} are read", path, info.st_size, max_bytes)};
  std::string text(status ? static_cast<std::size_t>(info.st_size) : 0, '\0');
  std::size_t size = 0;
  while (status && size < text.size()) {
    const ssize_t count = ::read(fd, text.data() + size, text.size() - size);
    if (count > 0) size += static_cast<std::size_t>(count);
    if (count == 0 || (count < 0 && errno != EINTR)) status = Error{fmt::format("{}: it cannot be read wholly", path)};
  }
  ::close(fd);
  if (!status) return status.error();
  return text;
}

}  // namespace ledgerline
