#include "chaincode/network/run_file.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

namespace ledgerline::fabric_network {

RunFile::~RunFile() {
  if (fd_ >= 0) ::close(fd_);
}

bool RunFile::take() {
  fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd_ < 0 || ::flock(fd_, LOCK_EX | LOCK_NB) != 0) return false;
  return write("");
}

bool RunFile::write(const std::string& text) const {
  return ::ftruncate(fd_, 0) == 0 && ::pwrite(fd_, text.data(), text.size(), 0) == static_cast<ssize_t>(text.size());
}

std::optional<nlohmann::json> RunFile::read() const {
  nlohmann::json json;
  // It may be writing just now.
  for (int tries = 0; tries < 5 && !json.is_object(); ++tries) {
    if (tries > 0) ::usleep(10'000);
    const int fd = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return std::nullopt;
    const bool held = ::flock(fd, LOCK_SH | LOCK_NB) != 0;
    ::close(fd);
    if (!held) return std::nullopt;
    std::ifstream in(path_);
    json = nlohmann::json::parse(in, nullptr, false);
  }
  return json.is_object() ? json : nlohmann::json::object();
}

}  // namespace ledgerline::fabric_network
