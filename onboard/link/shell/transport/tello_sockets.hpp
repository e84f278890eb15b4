#pragma once
#include <netinet/in.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/link/shell/transport/link_ends.hpp"
#include "onboard/link/shell/transport/udp.hpp"

namespace ledgerline::link {

/// The UDP sockets toward all drones. Commands: one for each drone, behind its interface where it has one, connected to
/// its address and command port, so that the kernel drops whatever else comes. State text: one for each interface,
/// since drones send it all to port 8890; a datagram is a drone's if it comes from the drone's address and state port,
/// and through its interface. A host in the drone's network can forge both.
class TelloSockets final : public Transport {
 public:
  /// Fails where one drone has no socket, or the port of the state texts is taken. In the first case send_first_zero()
  /// reaches the others nevertheless; in the second another program flies these drones.
  static Result<TelloSockets> create(const ShellSettings& settings);

  /// `command` and zero sticks to each drone, before the loop: one that still flies by the newest rc of a link that
  /// died stops, whatever this link waits for or fails in before its loop begins.
  void send_first_zero() noexcept;

  std::span<const Received> receive() noexcept override;
  bool send(const ToSend& message) noexcept override;
  /// Nothing without a trace that it is for.
  std::span<const AtDevice> at_device() noexcept override;

  /// A connected socket keeps its address and interface, so it is replaced where the way to the drone became another
  /// (Wi-Fi joined again, an adapter plugged in again). Returns that, and state text from ports that are not accepted.
  std::vector<std::string> refresh() override;

 private:
  static constexpr std::size_t max_received = 64;
  static constexpr std::size_t max_bytes = 1024;  // what clients receive with; a longer state text is no Tello's

  struct Drone {
    std::string name;
    DroneNumber number = 0;
    sockaddr_in address{};
    std::string interface;
    Descriptor commands;
    bool reached = false;  ///< a way to it was found; refresh()'s
    std::string reported;  ///< the newest trouble; refresh()'s
    bool reported_port = false;
    TimeNs sent_ns = 0;  ///< CLOCK_REALTIME before the newest datagram was sent, until its stamp is read; the loop's
  };
  struct StateText {
    std::string interface;
    Descriptor socket;
  };

  TelloSockets() = default;
  std::vector<int> state_fds() const;
  std::size_t read(int fd, sockaddr_in& from, bool& more) noexcept;
  void receive_answers(std::size_t drone) noexcept;
  void receive_states(const StateText& states) noexcept;
  bool is_from(const Drone& drone, const StateText& states, const sockaddr_in& from) noexcept;
  void refresh(Drone& drone, std::vector<std::string>& news);
  void refresh(StateText& states, std::vector<std::string>& news);

  std::vector<Drone> drones_;
  std::vector<StateText> states_;
  sockaddr_in state_listen_{};
  std::uint16_t state_port_ = 0;
  /// By drone: a port that its state text came from, though it is not the one; 0: none.
  std::unique_ptr<std::array<std::atomic<std::uint16_t>, max_drones>> strange_ports_;
  std::vector<std::array<char, max_bytes>> buffers_;
  std::array<Received, max_received> received_{};
  std::array<AtDevice, max_drones> at_device_{};
  bool stamps_ = false;
  std::size_t count_ = 0;
};

}  // namespace ledgerline::link
