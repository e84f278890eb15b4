#include "common/base/file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>
#include <utility>

namespace ledgerline {
namespace {

bool sync(const std::string& path, int flags) {
  const int fd = ::open(path.c_str(), flags | O_CLOEXEC);
  if (fd < 0) return false;
  const bool good = ::fsync(fd) == 0;
  const int why = errno;
  ::close(fd);
  errno = why;
  return good;
}

std::vector<unsigned> own_groups() {
  std::vector<gid_t> groups(static_cast<std::size_t>(std::max(0, ::getgroups(0, nullptr))));
  groups.resize(static_cast<std::size_t>(std::max(0, ::getgroups(static_cast<int>(groups.size()), groups.data()))));
  groups.push_back(::getegid());
  return {groups.begin(), groups.end()};
}

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

Result<std::string> read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  if (in.peek() != std::ifstream::traits_type::eof()) text << in.rdbuf();  // of nothing, << makes a failure
  if (!in.is_open() || in.bad() || text.fail()) return Error{"cannot read " + path};
  return text.str();
}

Status write_file(const std::string& path, std::string_view content, int mode) {
  std::error_code error;
  std::filesystem::create_directories(std::filesystem::path(path).parent_path(), error);  // open() says what is wrong
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, mode);
  struct stat is {};
  bool good = fd >= 0 && ::fstat(fd, &is) == 0;
  // The mode of a terminal or of /dev/null is not ours to change.
  if (good && S_ISREG(is.st_mode)) good = ::fchmod(fd, static_cast<mode_t>(mode)) == 0;
  while (good && !content.empty()) {
    const ssize_t n = ::write(fd, content.data(), content.size());
    good = n > 0 || (n < 0 && errno == EINTR);
    if (n > 0) content.remove_prefix(static_cast<std::size_t>(n));
  }
  const int why = errno;
  if (fd >= 0) ::close(fd);
  if (!good) return Error{"cannot write " + path + ": " + std::strerror(why)};
  return done;
}

Status replace_file(const std::string& path, std::string_view content, int mode) {
  const std::string fresh = path + ".new";
  if (auto status = write_file(fresh, content, mode); !status) return status;
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  const bool good = sync(fresh, O_WRONLY) && std::rename(fresh.c_str(), path.c_str()) == 0 &&
                    sync(folder.empty() ? "." : folder.string(), O_RDONLY | O_DIRECTORY);
  if (!good) return Error{"cannot write " + path + ": " + std::strerror(errno)};
  return done;
}

bool is_private(unsigned mode, unsigned owner, unsigned group, const std::vector<unsigned>& own_groups) {
  if ((mode & 077) == 0) return true;
  return (mode & 037) == 0 && owner == 0 && std::find(own_groups.begin(), own_groups.end(), group) != own_groups.end();
}

bool is_private(const struct stat& file) { return is_private(file.st_mode, file.st_uid, file.st_gid, own_groups()); }

void keep_memory_private() noexcept { (void)::prctl(PR_SET_DUMPABLE, 0); }  // which cannot fail

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

namespace fs = std::filesystem;

std::uint64_t bytes_below(const std::string& directory) {
  constexpr std::uint64_t stat_block = 512;  // whatever the file system's own
  std::uint64_t sum = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(directory, error), end; !error && entry != end; entry.increment(error)) {
    struct stat info {};
    if (::lstat(entry->path().c_str(), &info) == 0) sum += static_cast<std::uint64_t>(info.st_blocks) * stat_block;
  }
  return sum;
}

Result<fs::space_info> space_at(const std::string& path) {
  std::error_code error;
  fs::path place = fs::absolute(path, error);
  while (!fs::exists(place, error) && place.has_relative_path()) place = place.parent_path();
  const fs::space_info space = fs::space(place, error);
  if (error) return Error{fmt::format("looking at the room in {}: {}", place.string(), error.message())};
  return space;
}

Status check_folder_of(const std::string& file) {
  const std::filesystem::path folder = std::filesystem::path(file).parent_path();
  std::error_code error;
  if (folder.empty() || std::filesystem::is_directory(folder, error)) return done;
  return Error{fmt::format("{}: there is no folder {}", file, folder.string())};
}

Status check_space(const std::string& path, std::uint64_t needed, const std::string& for_what) {
  const auto space = space_at(path);
  if (!space) return space.error();
  if (space->available >= needed) return done;
  constexpr double mb = 1e6;
  return Error{fmt::format("{} has {:.0f} MB free, and {} needs {:.0f} MB: make room, or choose another place", path,
                           static_cast<double>(space->available) / mb, for_what, static_cast<double>(needed) / mb)};
}

}  // namespace ledgerline
