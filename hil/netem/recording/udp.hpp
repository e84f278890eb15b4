#pragma once
#include <netinet/in.h>

#include <cstdint>
#include <optional>
#include <string_view>

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

}  // namespace ledgerline::hil
