#include "common/program/secrets.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>

#include "common/base/files/private_file.hpp"

namespace ledgerline {

namespace {

/// A file that others may not read (is_private()), of at most `max_bytes`. An error names it and says the cure.
Result<std::string> read_secret_file(const std::string& file, std::size_t max_bytes) {
  const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return Error{fmt::format("cannot open {}: {}", file, std::strerror(errno))};
  std::string text;
  struct stat info {};
  const bool regular = ::fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
  const bool own = is_private(info);
  const bool fits = info.st_size <= static_cast<off_t>(max_bytes);
  ssize_t count = -1;
  if (regular && own && fits) {
    keep_memory_private();
    text.resize(static_cast<std::size_t>(info.st_size));
    count = ::read(fd, text.data(), text.size());
  }
  ::close(fd);
  if (!regular) return Error{file + " is no regular file"};
  if (!own) return Error{fmt::format("{} may be read by others than its owner; run: chmod 600 {}", file, file)};
  if (!fits) return Error{fmt::format("{} has more than {} bytes", file, max_bytes)};
  if (count < 0) return Error{"cannot read " + file};
  text.resize(static_cast<std::size_t>(count));
  return text;
}

}  // namespace

Result<std::string> read_secret(const std::string& file) {
  constexpr std::size_t max_bytes = 4096;
  auto text = read_secret_file(file, max_bytes);
  if (!text) return text;
  return text->substr(0, text->find_first_of("\r\n"));
}

Result<std::string> ask_secret(const std::string& prompt) {
  termios before{};
  const bool terminal = ::tcgetattr(STDIN_FILENO, &before) == 0;
  if (terminal) {
    termios without_echo = before;
    without_echo.c_lflag &= ~static_cast<tcflag_t>(ECHO);
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &without_echo);
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
