#pragma once
#include <sys/un.h>

#include <memory>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline::ipc {

/// Wakes another process: a datagram socket with a name. A notification carries no data, so the data is written before
/// it. Where the socket is full, earlier notifications wait in it that the owner clears before it reads the data. So
/// nothing is missed while the owner lives, and an owner that restarts reads the data at its start.
///
/// Its file belongs to the owner's user alone (mode 0600): the kernel refuses notifications of other users.
class WakeupSink {
 public:
  /// Replaces the socket that a dead owner left. No other owner of this path may live.
  static Result<std::unique_ptr<WakeupSink>> create(const std::string& path);
  ~WakeupSink();
  WakeupSink(const WakeupSink&) = delete;
  WakeupSink& operator=(const WakeupSink&) = delete;

  /// Readable from a notification to the next clear().
  int fd() const noexcept { return fd_; }
  /// True if a notification came since the last call. To be called before the data is read. Does not wait.
  bool clear() noexcept;

 private:
  WakeupSink(int fd, std::string path) : fd_(fd), path_(std::move(path)) {}
  const int fd_;
  const std::string path_;
};

/// The other end. Knows the path alone, so it outlives sinks, and may be there before the first one.
class WakeupSource {
 public:
  static Result<WakeupSource> create(const std::string& path);
  WakeupSource(WakeupSource&& other) noexcept;
  WakeupSource& operator=(WakeupSource&&) = delete;
  ~WakeupSource();

  /// One send that does not wait. Without a sink, or with a full one, it does nothing.
  void notify() noexcept;

 private:
  WakeupSource(int fd, const sockaddr_un& address) : fd_(fd), address_(address) {}
  int fd_;
  sockaddr_un address_;
};

}  // namespace ledgerline::ipc
