#pragma once
#include <netinet/in.h>
#include <unistd.h>

#include <optional>
#include <span>
#include <string>
#include <utility>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

/// UDP sockets as link needs them: non-blocking, and behind one network interface where one is named. Errors say what
/// to do. Any thread, but not the real-time loop, unless said.
namespace ledgerline::link {

class Descriptor {
 public:
  explicit Descriptor(int fd = -1) noexcept : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const noexcept { return fd_; }

 private:
  int fd_;
};

/// "192.168.10.1:8889".
std::string text(const sockaddr_in& address);

/// A socket that hears and reaches nothing but what is behind `interface`; empty: any. Fails where there is no such
/// interface, or where this process may not choose one: before Linux 5.7 that takes CAP_NET_RAW.
Result<Descriptor> open_udp(const std::string& interface);

/// Fails where any other socket has a part of this, and lets none in behind it: of two sockets that share a port
/// (SO_REUSEADDR, of any process) the newer or more exact one gets the datagrams.
Status listen_alone(const Descriptor& socket, const sockaddr_in& address);
/// The same, but beside sockets of this program, `own`, which share the port for the moment of the bind alone.
Status listen_beside(std::span<const int> own, const Descriptor& socket, const sockaddr_in& address);

/// From now on the kernel drops what does not come from exactly there. False where no route leads there yet.
bool connect_to(const Descriptor& socket, const sockaddr_in& address) noexcept;

/// From now on sent_at() reports what this socket sends.
Status stamp_sends(const Descriptor& socket);
/// When the network device had a datagram of this socket that was sent at `since_ns` or later: CLOCK_REALTIME, from the
/// kernel's software stamp. None: no device had one yet, or its driver does not stamp. Does not wait; the loop's.
std::optional<TimeNs> sent_at(const Descriptor& socket, TimeNs since_ns) noexcept;

/// By its index: an adapter that was unplugged and plugged in again has another, by the same name.
bool same_interface(int one, int other) noexcept;
/// Of their own: a Wi-Fi that is joined again may lend another.
bool same_address(int one, int other) noexcept;

/// In one step, for threads that read and write `old` meanwhile: its number now names the other one.
Status put_in_place_of(int old, Descriptor replacement);

}  // namespace ledgerline::link
