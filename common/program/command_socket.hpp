#pragma once
#include <poll.h>

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline {

/// A Unix socket (stream, mode 0600: its user's alone) on which a running program gets commands: one line each, and
/// an answer of lines that ends with one empty line. The first word of an answer is `ok` or `error:`. Bounded: a few
/// askers at a time, each with a line of at most 1,000 bytes, and gone after some seconds of silence. One thread.
class CommandSocket {
 public:
  /// What a command does; its text is the answer behind `ok`.
  using Do = std::function<Result<std::string>(const std::string& command)>;

  /// Takes over a socket that nobody serves any more; the error says who is in the way, or that the path is too long.
  static Result<CommandSocket> open(const std::string& path);
  CommandSocket(CommandSocket&& other) noexcept;
  CommandSocket& operator=(CommandSocket&&) = delete;
  ~CommandSocket();

  void add_to(TimeNs now, std::vector<pollfd>& polled) const;
  /// `polled`: what add_to() added, after poll().
  void serve(TimeNs now, std::span<const pollfd> polled, const Do& act);

 private:
  struct Connection {
    int fd = -1;
    std::string line = {};
    TimeNs until = 0;
  };
  CommandSocket() = default;
  bool serve(Connection& connection, const Do& act);

  std::string path_;  // its own, to be removed
  int listener_ = -1;
  std::vector<Connection> connections_;
  TimeNs accept_from_ = 0;  // when this process may open no more files it waits a while
};

/// Tells one command to the program behind the socket: its answer, or what went wrong. `timeout_ns`: of all of it.
Result<std::string> send_command(const std::string& socket_path, const std::string& command,
                                 TimeNs timeout_ns = 5 * ns_per_s);

}  // namespace ledgerline
