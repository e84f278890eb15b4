#include "hil/netem/recording/udp.hpp"

#include <arpa/inet.h>
#include <net/ethernet.h>
#include <netinet/ip.h>
#include <netinet/udp.h>
#include <pcap/dlt.h>

#include <algorithm>
#include <cstring>

namespace ledgerline::hil {
namespace {

/// The header at the beginning, which is taken off; nothing: there is not so much.
template <typename Header>
std::optional<Header> take(std::string_view& bytes) {
  if (bytes.size() < sizeof(Header)) return std::nullopt;
  Header header;
  std::memcpy(&header, bytes.data(), sizeof header);
  bytes.remove_prefix(sizeof header);
  return header;
}

struct CookedHeader {  // DLT_LINUX_SLL
  std::uint16_t type, address_type, address_length;
  std::uint8_t address[8];
  std::uint16_t protocol;
};
static_assert(sizeof(CookedHeader) == 16);

struct CookedHeader2 {  // DLT_LINUX_SLL2
  std::uint16_t protocol, reserved;
  std::uint32_t interface;
  std::uint16_t address_type;
  std::uint8_t type, address_length;
  std::uint8_t address[8];
};
static_assert(sizeof(CookedHeader2) == 20);

struct VlanTag {
  std::uint16_t tag, protocol;
};

/// Takes the link's header off; false where no IPv4 packet is behind it.
bool take_link_header(int link_type, std::string_view& bytes) {
  if (link_type == DLT_RAW || link_type == DLT_IPV4) return true;
  if (link_type == DLT_NULL || link_type == DLT_LOOP) return take<std::uint32_t>(bytes).has_value();  // IP says which
  if (link_type == DLT_LINUX_SLL) {
    const auto header = take<CookedHeader>(bytes);
    return header && ntohs(header->protocol) == ETHERTYPE_IP;
  }
  if (link_type == DLT_LINUX_SLL2) {
    const auto header = take<CookedHeader2>(bytes);
    return header && ntohs(header->protocol) == ETHERTYPE_IP;
  }
  if (link_type != DLT_EN10MB) return false;
  const auto header = take<ether_header>(bytes);
  if (!header) return false;
  std::uint16_t protocol = ntohs(header->ether_type);
  constexpr std::uint16_t provider_vlan = 0x88a8;  // 802.1ad
  constexpr int max_tags = 2;
  for (int i = 0; i < max_tags && (protocol == ETHERTYPE_VLAN || protocol == provider_vlan); ++i) {
    const auto tag = take<VlanTag>(bytes);
    if (!tag) return false;
    protocol = ntohs(tag->protocol);
  }
  return protocol == ETHERTYPE_IP;
}

}  // namespace

bool reads_link_type(int link_type) {
  constexpr int read[] = {DLT_EN10MB, DLT_LINUX_SLL, DLT_LINUX_SLL2, DLT_NULL, DLT_LOOP, DLT_RAW, DLT_IPV4};
  return std::find(std::begin(read), std::end(read), link_type) != std::end(read);
}

std::optional<CapturedDatagram> datagram_in(int link_type, std::string_view packet) {
  if (!take_link_header(link_type, packet)) return std::nullopt;
  std::string_view bytes = packet;
  const auto ip = take<iphdr>(bytes);
  constexpr unsigned words_at_least = 5;
  if (!ip || ip->version != IPVERSION || ip->ihl < words_at_least || ip->protocol != IPPROTO_UDP) return std::nullopt;
  if ((ntohs(ip->frag_off) & (IP_OFFMASK | IP_MF)) != 0) return std::nullopt;
  const std::size_t header = ip->ihl * std::size_t{4}, total = ntohs(ip->tot_len);
  if (total < header || packet.size() < header) return std::nullopt;
  bytes = packet.substr(header, total - header);  // behind it: what pads a short frame
  const auto udp = take<udphdr>(bytes);
  if (!udp || ntohs(udp->len) < sizeof(udphdr)) return std::nullopt;
  CapturedDatagram datagram;
  datagram.from.s_addr = ip->saddr;
  datagram.to.s_addr = ip->daddr;
  datagram.from_port = ntohs(udp->source);
  datagram.to_port = ntohs(udp->dest);
  datagram.ip_id = ntohs(ip->id);
  datagram.payload = bytes.substr(0, ntohs(udp->len) - sizeof(udphdr));
  return datagram;
}

}  // namespace ledgerline::hil
