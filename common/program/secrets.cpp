#include "common/program/secrets.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>

namespace ledgerline {

Result<std::string> read_secret(const std::string& file) {
  const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return Error{fmt::format("cannot open {}: {}", file, std::strerror(errno))};
  std::array<char, 4096> bytes{};
  struct stat info {};
  const bool regular = ::fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
  const bool own = (info.st_mode & 077) == 0;
  const ssize_t count = regular && own ? ::read(fd, bytes.data(), bytes.size()) : -1;
  ::close(fd);
  if (!regular) return Error{file + " is no regular file"};
  if (!own) return Error{fmt::format("{} may be read by others than its owner; run: chmod 600 {}", file, file)};
  if (count < 0) return Error{"cannot read " + file};
  const std::string text(bytes.data(), static_cast<std::size_t>(count));
  const auto end = text.find_first_of("\r\n");
  if (end == std::string::npos && text.size() == bytes.size())
    return Error{file + " has a first line of more than 4 kB"};
  return text.substr(0, end);
}

Result<std::string> ask_secret(const std::string& prompt) {
  termios before{};
  const bool terminal = ::tcgetattr(STDIN_FILENO, &before) == 0;
  if (terminal) {
    termios unseen = before;
    unseen.c_lflag &= ~static_cast<tcflag_t>(ECHO);
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &unseen);
    std::fprintf(stderr, "%s: ", prompt.c_str());
  }
  std::string secret;
  const bool read = static_cast<bool>(std::getline(std::cin, secret));
  if (terminal) {
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &before);
    std::fputs("\n", stderr);
  }
  if (!read) return Error{prompt + ": none was given"};
  return secret;
}

}  // namespace ledgerline
