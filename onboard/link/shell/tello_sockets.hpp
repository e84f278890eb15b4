#pragma once
#include <netinet/in.h>

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/base/result.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/shell/link_config.hpp"

namespace ledgerline::link {

/// The two UDP sockets toward all drones: one for commands and answers, one for state text. Drones are told apart by
/// source address. Non-blocking, no allocation after creation; one thread.
class TelloSockets {
 public:
  static Result<TelloSockets> create(const ShellSettings& settings);
  TelloSockets(TelloSockets&& other) noexcept;
  TelloSockets& operator=(TelloSockets&&) = delete;
  ~TelloSockets();

  /// Everything that has come, up to a bound; valid until the next call.
  std::span<const Received> receive() noexcept;
  /// False when the system refused it, which the caller counts: to a drone it is a lost datagram.
  bool send(const ToSend& message) noexcept;

 private:
  static constexpr std::size_t max_received = 64;
  static constexpr std::size_t max_bytes = 1024;  // what clients receive with; a longer state text is no Tello's

  TelloSockets() = default;
  void receive_from(int fd, Port port) noexcept;

  int command_fd_ = -1;
  int state_fd_ = -1;
  std::vector<DroneNumber> numbers_;
  std::vector<sockaddr_in> addresses_;
  std::vector<std::array<char, max_bytes>> buffers_;
  std::array<Received, max_received> received_{};
  std::size_t count_ = 0;
};

}  // namespace ledgerline::link
