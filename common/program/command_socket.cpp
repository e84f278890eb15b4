#include "common/program/command_socket.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

namespace ledgerline {
namespace {

constexpr std::size_t max_connections = 8, max_line = 1'000, max_answer = 1'000'000;
constexpr TimeNs timeout = 5 * ns_per_s, accept_pause = 100 * ns_per_ms;

Result<sockaddr_un> place(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path)
    return Error{fmt::format("{}: a socket's path has at most {} bytes: choose a shorter one", path,
                             sizeof address.sun_path - 1)};
  std::copy(path.begin(), path.end(), address.sun_path);
  return address;
}

bool reaches(const sockaddr_un& address) {
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const bool good = fd >= 0 && ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  if (fd >= 0) ::close(fd);
  return good;
}

bool send_all(int fd, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(sent));
  }
  return true;
}

/// Nothing would mean for ever.
bool set_timeout(int fd, int option, TimeNs timeout_ns) {
  const TimeNs us = std::max<TimeNs>(1, timeout_ns / ns_per_us);
  const timeval wait{us / 1'000'000, us % 1'000'000};
  return ::setsockopt(fd, SOL_SOCKET, option, &wait, sizeof wait) == 0;
}

}  // namespace

Result<CommandSocket> CommandSocket::open(const std::string& path) {
  const auto address = place(path);
  if (!address) return address.error();
  struct stat there {};
  if (::lstat(path.c_str(), &there) == 0) {
    if (!S_ISSOCK(there.st_mode)) return Error{path + " is there already, and is no socket"};
    if (reaches(*address)) return Error{path + " is another program's: end it, or choose another path"};
    ::unlink(path.c_str());
  }
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const mode_t before = ::umask(0177);  // so that it is never open to others, not even for a moment
  const bool bound = fd >= 0 && ::bind(fd, reinterpret_cast<const sockaddr*>(&*address), sizeof *address) == 0;
  const int why = errno;
  ::umask(before);
  CommandSocket out;
  out.listener_ = fd;
  if (!bound) return Error{fmt::format("cannot make the socket {}: {}", path, std::strerror(why))};
  out.path_ = path;
  if (::listen(fd, max_connections) != 0)
    return Error{fmt::format("cannot listen on {}: {}", path, std::strerror(errno))};
  return out;
}

CommandSocket::CommandSocket(CommandSocket&& other) noexcept
    : path_(std::exchange(other.path_, {})),
      listener_(std::exchange(other.listener_, -1)),
      connections_(std::exchange(other.connections_, {})) {}

CommandSocket::~CommandSocket() {
  for (const Connection& connection : connections_) ::close(connection.fd);
  if (listener_ >= 0) ::close(listener_);
  if (!path_.empty()) ::unlink(path_.c_str());
}

void CommandSocket::add_to(TimeNs now, std::vector<pollfd>& polled) const {
  polled.push_back({connections_.size() < max_connections && now >= accept_from_ ? listener_ : -1, POLLIN, 0});
  for (const Connection& connection : connections_) polled.push_back({connection.fd, POLLIN, 0});
}

void CommandSocket::serve(TimeNs now, std::span<const pollfd> polled, const Do& act) {
  for (std::size_t i = 0; i < connections_.size(); ++i) {
    Connection& connection = connections_[i];
    const bool spoke = polled[i + 1].revents != 0;
    if (spoke ? serve(connection, act) : now < connection.until) {
      if (spoke) connection.until = now + timeout;
      continue;
    }
    ::close(std::exchange(connection.fd, -1));
  }
  std::erase_if(connections_, [](const Connection& connection) { return connection.fd < 0; });
  if (polled[0].revents == 0) return;
  const int fd = ::accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (fd >= 0)
    connections_.push_back({fd, {}, now + timeout});
  else if (errno != EAGAIN && errno != EINTR && errno != ECONNABORTED)
    accept_from_ = now + accept_pause;
}

bool CommandSocket::serve(Connection& connection, const Do& act) {
  std::array<char, max_line> buffer;
  const ssize_t got = ::recv(connection.fd, buffer.data(), buffer.size(), 0);
  if (got <= 0) return got < 0 && (errno == EAGAIN || errno == EINTR);
  connection.line.append(buffer.data(), static_cast<std::size_t>(got));
  for (std::size_t end; (end = connection.line.find('\n')) != std::string::npos;) {
    const auto result = act(connection.line.substr(0, end));
    connection.line.erase(0, end + 1);
    const std::string answer = result ? "ok\n" + *result : "error: " + result.error().message + "\n";
    // An answer fits the socket's buffer; who lets several of them lie there is let go.
    if (!send_all(connection.fd, answer + "\n")) return false;
  }
  return connection.line.size() <= max_line;
}

Result<std::string> send_command(const std::string& socket_path, const std::string& command, TimeNs timeout_ns) {
  const auto address = place(socket_path);
  if (!address) return address.error();
  if (command.find('\n') != std::string::npos || command.size() >= max_line)
    return Error{fmt::format("a command is one line of less than {} bytes", max_line)};
  const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const TimeNs until = monotonic_ns() + timeout_ns;
  // A connection, too, waits as long as sending may: where nobody accepts.
  bool good = fd >= 0 && set_timeout(fd, SO_SNDTIMEO, timeout_ns) &&
              ::connect(fd, reinterpret_cast<const sockaddr*>(&*address), sizeof *address) == 0 &&
              send_all(fd, command + "\n");
  std::string answer;
  int why = good ? 0 : errno;
  while (good && !answer.ends_with("\n\n") && answer.size() < max_answer) {
    std::array<char, 4'096> buffer;
    const TimeNs left = until - monotonic_ns();
    errno = ETIMEDOUT;
    const ssize_t got =
        left > 0 && set_timeout(fd, SO_RCVTIMEO, left) ? ::recv(fd, buffer.data(), buffer.size(), 0) : -1;
    good = got > 0;
    why = got == 0 ? ECONNRESET : errno;
    if (good) answer.append(buffer.data(), static_cast<std::size_t>(got));
  }
  if (fd >= 0) ::close(fd);
  if (!good) return Error{fmt::format("{} does not answer: {}", socket_path, std::strerror(why))};
  while (answer.ends_with("\n")) answer.pop_back();
  if (answer.starts_with("error: ")) return Error{answer.substr(7)};
  if (answer.starts_with("ok")) return answer.size() > 3 ? answer.substr(3) + "\n" : "";
  return Error{fmt::format("{} is no socket for commands: it answered \"{}\"", socket_path, answer.substr(0, 100))};
}

}  // namespace ledgerline
