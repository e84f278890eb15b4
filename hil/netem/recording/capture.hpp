#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "hil/netem/recording/lateness.hpp"

namespace ledgerline::hil {

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
/// max_captured_drones, and it spans at most RecordedDay::max_length; beyond, or where libpcap finds it damaged, it is
/// refused with the reason.
inline constexpr std::uint64_t max_packets = 50'000'000;
inline constexpr std::size_t max_states = 1'000'000, max_talk = 500'000, max_captured_drones = 64;
Result<std::vector<CapturedLink>> read_capture(const std::string& path);

/// The one of this address; without an address the only one. The error says which there are.
Result<CapturedLink> link_of(const std::vector<CapturedLink>& links, const std::string& drone);

}  // namespace ledgerline::hil
