#include "onboard/link/shell/memory/starts.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace ledgerline::link {

Result<int> note_start(const std::string& file, TimeNs now) {
  // Slots of the newest starts, the oldest of which gives way: one write, so that a kill tears nothing.
  std::array<TimeNs, 64> starts{};
  const int fd = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  const auto failed = [&] { return Error{fmt::format("output.starts: {}: {}", file, std::strerror(errno))}; };
  if (fd < 0) return failed();
  if (::pread(fd, starts.data(), sizeof starts, 0) != static_cast<ssize_t>(sizeof starts)) starts = {};
  std::size_t oldest = 0;
  int count = 1;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    if (starts[i] <= 0 || starts[i] > now || now - starts[i] > starts_within_ns) starts[i] = 0;
    if (starts[i] != 0) ++count;
    if (starts[i] < starts[oldest]) oldest = i;
  }
  starts[oldest] = now;
  const bool written = ::pwrite(fd, starts.data(), sizeof starts, 0) == static_cast<ssize_t>(sizeof starts);
  const Error error = failed();
  ::close(fd);
  if (!written) return error;
  return std::min(count, static_cast<int>(starts.size()));
}

}  // namespace ledgerline::link
