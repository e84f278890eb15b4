#include "common/base/file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace ledgerline {

Result<std::string> read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  if (!in || !(text << in.rdbuf())) return Error{"cannot read " + path};
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

}  // namespace

Status replace_file(const std::string& path, std::string_view content, int mode) {
  const std::string fresh = path + ".new";
  if (auto status = write_file(fresh, content, mode); !status) return status;
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  const bool good = sync(fresh, O_WRONLY) && std::rename(fresh.c_str(), path.c_str()) == 0 &&
                    sync(folder.empty() ? "." : folder.string(), O_RDONLY | O_DIRECTORY);
  if (!good) return Error{"cannot write " + path + ": " + std::strerror(errno)};
  return done;
}

}  // namespace ledgerline
