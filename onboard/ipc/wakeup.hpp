#pragma once
#include <sys/un.h>

#include <memory>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline::ipc {

/// Wakes another process: a datagram socket with a name. A ring says only "look", so it comes behind what is to be
/// seen. Where the socket is full, rings wait in it that the owner has yet to clear, before it looks. So a look is
/// never missed while the owner lives, and an owner that restarts looks at its start.
///
/// Its file belongs to the owner's user alone (mode 0600): the kernel turns away rings of other users.
class WakeupSink {
 public:
  /// Takes the place of a wakeup that a dead owner left. No other owner of this path may live.
  static Result<std::unique_ptr<WakeupSink>> create(const std::string& path);
  ~WakeupSink();
  WakeupSink(const WakeupSink&) = delete;
  WakeupSink& operator=(const WakeupSink&) = delete;

  /// Readable from a ring to the next clear().
  int fd() const noexcept { return fd_; }
  /// True if it rang since the last call. To be called before the look that it asks for. Does not wait.
  bool clear() noexcept;

 private:
  WakeupSink(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
  const int fd_;
  const std::string path_;
};

/// The other end. Knows the path alone, so it outlives owners of the wakeup, and may be there before the first one.
class WakeupSource {
 public:
  static Result<WakeupSource> create(const std::string& path);
  WakeupSource(WakeupSource&& other) noexcept;
  WakeupSource& operator=(WakeupSource&&) = delete;
  ~WakeupSource();

  /// One send that does not wait. Nobody is there, or the wakeup is full: nothing is to be done.
  void pull() noexcept;

 private:
  WakeupSource(int fd, const sockaddr_un& address) : fd_(fd), address_(address) {}
  int fd_;
  sockaddr_un address_;
};

}  // namespace ledgerline::ipc
