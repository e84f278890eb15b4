#pragma once
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <net/ethernet.h>
#include <netinet/ip.h>
#include <netinet/udp.h>
#include <pcap/pcap.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"

// Captures of a Tello's link as tcpdump at the client writes them.
namespace ledgerline::hil {

/// A file that is gone at the end.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& name)
      : path(std::filesystem::temp_directory_path() / (std::to_string(::getpid()) + "-" + name)) {}
  ~TemporaryFile() { std::filesystem::remove(path); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const std::string path;
};

struct Packet {
  TimeNs at = 0;
  std::string from, to;
  std::uint16_t from_port = 0, to_port = 0;
  std::string payload;
  std::uint16_t ip_id = 0;
};

inline constexpr TimeNs ms = ns_per_ms;
inline constexpr const char* drone_address = "192.168.10.1";
inline constexpr const char* client_address = "192.168.10.2";

inline Packet state_at(TimeNs at, const std::string& text = "pitch:0;h:0;tof:10;bat:87;\r\n", std::uint16_t id = 0) {
  return {at, drone_address, client_address, 8889, 8890, text, id};
}
inline Packet said_at(TimeNs at, const std::string& command, std::uint16_t id = 0) {
  return {at, client_address, drone_address, 8889, 8889, command, id};
}
inline Packet answer_at(TimeNs at, const std::string& answer, std::uint16_t id = 0) {
  return {at, drone_address, client_address, 8889, 8889, answer, id};
}

template <typename Header>
void append(std::string& bytes, const Header& header) {
  bytes.append(reinterpret_cast<const char*>(&header), sizeof header);
}

/// The packet from its IP header on.
inline std::string ip_packet(const Packet& packet) {
  iphdr ip{};
  ip.version = IPVERSION;
  ip.ihl = 5;
  ip.protocol = IPPROTO_UDP;
  ip.id = htons(packet.ip_id);
  ip.tot_len = htons(static_cast<std::uint16_t>(sizeof(iphdr) + sizeof(udphdr) + packet.payload.size()));
  ip.saddr = ::inet_addr(packet.from.c_str());
  ip.daddr = ::inet_addr(packet.to.c_str());
  udphdr udp{};
  udp.source = htons(packet.from_port);
  udp.dest = htons(packet.to_port);
  udp.len = htons(static_cast<std::uint16_t>(sizeof(udphdr) + packet.payload.size()));
  std::string bytes;
  append(bytes, ip);
  append(bytes, udp);
  return bytes + packet.payload;
}

inline std::string ethernet_frame(const Packet& packet) {
  ether_header ethernet{};
  ethernet.ether_type = htons(ETHERTYPE_IP);
  std::string bytes;
  append(bytes, ethernet);
  bytes += ip_packet(packet);
  constexpr std::size_t shortest = 60;
  bytes.resize(std::max(shortest, bytes.size()));  // as hardware pads
  return bytes;
}

/// Frames with their times, written by libpcap.
inline void write_frames(const std::string& path, int link_type,
                         const std::vector<std::pair<TimeNs, std::string>>& frames) {
  constexpr int snap_length = 65'535;
  pcap_t* const dead = pcap_open_dead_with_tstamp_precision(link_type, snap_length, PCAP_TSTAMP_PRECISION_NANO);
  ASSERT_NE(dead, nullptr);
  pcap_dumper_t* const dump = pcap_dump_open(dead, path.c_str());
  ASSERT_NE(dump, nullptr) << pcap_geterr(dead);
  constexpr std::int64_t some_day_s = 1'790'000'000;
  for (const auto& [at, bytes] : frames) {
    pcap_pkthdr header{};
    header.ts.tv_sec = some_day_s + at / ns_per_s;
    header.ts.tv_usec = at % ns_per_s;
    header.caplen = header.len = static_cast<bpf_u_int32>(bytes.size());
    pcap_dump(reinterpret_cast<u_char*>(dump), &header, reinterpret_cast<const u_char*>(bytes.data()));
  }
  pcap_dump_close(dump);
  pcap_close(dead);
}

inline void write_capture(const std::string& path, const std::vector<Packet>& packets) {
  std::vector<std::pair<TimeNs, std::string>> frames;
  for (const Packet& packet : packets) frames.emplace_back(packet.at, ethernet_frame(packet));
  write_frames(path, DLT_EN10MB, frames);
}

}  // namespace ledgerline::hil
