#pragma once
#include <netinet/in.h>

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "hil/netem/recording/lateness.hpp"

namespace ledgerline::hil {

/// A UDP datagram over IPv4 as it lies in a captured packet; its bytes are the packet's.
struct CapturedDatagram {
  in_addr from{}, to{};
  std::uint16_t from_port = 0, to_port = 0;
  std::uint16_t ip_id = 0;
  std::string_view payload;  ///< what of it was captured
};

/// The link types that are read: Ethernet (with VLAN tags), Linux's cooked ones (`tcpdump -i any`), loopback, bare IP.
bool reads_link_type(int link_type);

/// In a packet of a link type of libpcap's (DLT_...). Nothing: another protocol, a fragment, or not all of its headers.
/// Any bytes may come in.
std::optional<CapturedDatagram> datagram_in(int link_type, std::string_view packet);

/// What a capture has of one drone.
struct CapturedLink {
  std::string drone;               ///< its address
  std::vector<TimeNs> states;      ///< when its state texts arrived, since the capture's first packet; ascending
  std::vector<RequestTime> asked;  ///< commands that a drone answers at once, in their order
};

/// Reads a capture made at the client (pcap or pcapng, by libpcap): state texts are what goes to port 8890, commands
/// what goes to port 8889 of a drone, answers what comes from there. A drone is a host that sends state texts, or
/// is sent `command`. What was captured twice (the same IP id and bytes) counts once.
///
/// An untrusted file: at most max_packets are read, max_states and max_talk of its datagrams kept, of at most
/// max_captured_drones, and it spans at most LinkRecording::max_length; beyond, or where libpcap finds it damaged, it
/// is refused with the reason.
inline constexpr std::uint64_t max_packets = 50'000'000;
inline constexpr std::size_t max_states = 1'000'000, max_talk = 500'000, max_captured_drones = 64;
Result<std::vector<CapturedLink>> read_capture(const std::string& path);

/// The one of this address; without an address the only one. The error says which there are.
Result<CapturedLink> link_of(const std::vector<CapturedLink>& links, const std::string& drone);

}  // namespace ledgerline::hil
