#pragma once
#include <sys/un.h>

#include <memory>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline::ipc {

/// Wakes another process: a datagram socket with a name. A ring says only "look", so it comes behind what is to be
/// seen. Where the socket is full, rings wait in it that the owner has yet to clear, before it looks. So a look is
/// never missed while the owner lives, and one that starts anew looks at its start.
///
/// Its file belongs to the owner's user alone (mode 0600): the kernel turns away rings of other users.
class Bell {
 public:
  /// Takes the place of a bell that a dead owner left. No other owner of this path may live.
  static Result<std::unique_ptr<Bell>> create(const std::string& path);
  ~Bell();
  Bell(const Bell&) = delete;
  Bell& operator=(const Bell&) = delete;

  /// Readable from a ring to the next clear().
  int fd() const noexcept { return fd_; }
  /// True if it rang since the last call. To be called before the look that it asks for. Does not wait.
  bool clear() noexcept;

 private:
  Bell(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
  const int fd_;
  const std::string path_;
};

/// The other end. Knows the path alone, so it outlives owners of the bell, and may be there before the first one.
class BellRope {
 public:
  static Result<BellRope> create(const std::string& path);
  BellRope(BellRope&& other) noexcept;
  BellRope& operator=(BellRope&&) = delete;
  ~BellRope();

  /// One send that does not wait. Nobody is there, or the bell is full: nothing is to be done.
  void pull() noexcept;

 private:
  BellRope(int fd, const sockaddr_un& address) : fd_(fd), address_(address) {}
  int fd_;
  sockaddr_un address_;
};

}  // namespace ledgerline::ipc
