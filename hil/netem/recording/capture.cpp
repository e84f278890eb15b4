#include "hil/netem/recording/capture.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <net/ethernet.h>
#include <netinet/ip.h>
#include <netinet/udp.h>
#include <pcap/dlt.h>
#include <pcap/pcap.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <utility>

#include "common/msg/onboard.hpp"
#include "hil/netem/sdk/calls.hpp"

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

namespace {

constexpr std::size_t max_text = 64;  // of a command or an answer: enough to know it

std::string address_text(std::uint32_t address) {
  std::array<char, INET_ADDRSTRLEN> text{};
  const in_addr in{address};
  ::inet_ntop(AF_INET, &in, text.data(), text.size());
  return text.data();
}

/// What goes through a capture, in its order.
class Listener {
 public:
  Status take(TimeNs at, const CapturedDatagram& datagram) {
    if (datagram.to_port == state_port) return take_state(at, datagram);
    if (datagram.to_port != command_port && datagram.from_port != command_port) return done;
    const std::string_view text = datagram.payload.substr(0, max_text);
    const std::string_view word = call_word(text);
    if (word == "rc" || said_[{datagram.from.s_addr, datagram.to.s_addr}].again(datagram)) return done;
    if (talk_.size() == max_talk)
      return Error{fmt::format("more than {} commands and answers: cut it into shorter ones", max_talk)};
    if (datagram.to_port == command_port && word == "command") {
      if (const Status added = add_drone(datagram.to.s_addr); !added) return added;
    }
    talk_.push_back(
        {at, datagram.from.s_addr, datagram.to.s_addr, datagram.from_port, datagram.to_port, std::string(text)});
    return done;
  }

  std::vector<CapturedLink> links() const {
    std::vector<CapturedLink> links;
    for (const std::uint32_t drone : drones_) {
      CapturedLink link{address_text(drone), {}, asked_of(drone)};
      if (const auto found = heard_.find(drone); found != heard_.end()) link.states = found->second.states;
      links.push_back(std::move(link));
    }
    return links;
  }

 private:
  /// Of one direction.
  struct Newest {
    std::uint16_t id = 0;
    std::size_t bytes = 0;  // as a hash

    bool again(const CapturedDatagram& datagram) {
      const std::uint16_t id_before = std::exchange(id, datagram.ip_id);
      const std::size_t bytes_before = std::exchange(bytes, std::hash<std::string_view>()(datagram.payload));
      return id != 0 && id == id_before && bytes == bytes_before;
    }
  };
  struct Datagrams {
    std::vector<TimeNs> states;
    Newest newest;
  };
  struct Talk {
    TimeNs at = 0;
    std::uint32_t from = 0, to = 0;
    std::uint16_t from_port = 0, to_port = 0;
    std::string text;
  };

  Status add_drone(std::uint32_t address) {
    if (drones_.size() == max_captured_drones && drones_.count(address) == 0)
      return Error{fmt::format("more than {} hosts send to port {} or are sent `command`: no Tellos",
                               max_captured_drones, state_port)};
    drones_.insert(address);
    return done;
  }

  Status take_state(TimeNs at, const CapturedDatagram& datagram) {
    if (const Status added = add_drone(datagram.from.s_addr); !added) return added;
    Datagrams& heard = heard_[datagram.from.s_addr];
    if (heard.newest.again(datagram)) return done;
    if (states_++ == max_states)
      return Error{fmt::format("more than {} state texts: cut it into shorter ones", max_states)};
    heard.states.push_back(at);
    return done;
  }

  std::vector<RequestTime> asked_of(std::uint32_t drone) const {
    std::vector<RequestTime> asked;
    OpenCalls open;
    for (const Talk& talk : talk_) {
      if (talk.to == drone && talk.to_port == command_port) {
        const std::string_view word = call_word(talk.text);
        if (how_answered(word) == Answered::at_once) asked.push_back({talk.at});
        open.command(talk.at, talk.text, asked.size());
      } else if (talk.from == drone && talk.from_port == command_port) {
        const auto call = open.match(talk.at, talk.text);
        if (call && how_answered(call->word) == Answered::at_once) asked[call->tag - 1].answered_ns = talk.at;
      }
    }
    return asked;
  }

  std::map<std::uint32_t, Datagrams> heard_;
  std::map<std::pair<std::uint32_t, std::uint32_t>, Newest> said_;  // by who says it to whom: no more than talk_
  std::set<std::uint32_t> drones_;
  std::vector<Talk> talk_;
  std::size_t states_ = 0;
};

}  // namespace

Result<std::vector<CapturedLink>> read_capture(const std::string& path) {
  std::array<char, PCAP_ERRBUF_SIZE> why{};
  const std::unique_ptr<pcap_t, decltype(&pcap_close)> capture(
      pcap_open_offline_with_tstamp_precision(path.c_str(), PCAP_TSTAMP_PRECISION_NANO, why.data()), pcap_close);
  if (!capture) return Error{fmt::format("{}: no capture that libpcap reads: {}", path, why.data())};
  const int link_type = pcap_datalink(capture.get());
  if (!reads_link_type(link_type)) {
    const char* const name = pcap_datalink_val_to_name(link_type);
    return Error{fmt::format("{}: packets of link type {}: Ethernet, Linux cooked, loopback and bare IP are read", path,
                             name ? name : std::to_string(link_type))};
  }
  Listener listener;
  std::optional<TimeNs> first;
  TimeNs last = 0;
  for (std::uint64_t packets = 0;; ++packets) {
    pcap_pkthdr* header = nullptr;
    const u_char* bytes = nullptr;
    const int got = pcap_next_ex(capture.get(), &header, &bytes);
    if (got == PCAP_ERROR_BREAK) break;
    if (got != 1)
      return Error{fmt::format("{}: damaged behind {} packets: {}", path, packets, pcap_geterr(capture.get()))};
    if (packets == max_packets)
      return Error{fmt::format("{}: more than {} packets: keep UDP ports 8889 and 8890 alone", path, max_packets)};
    constexpr std::int64_t max_seconds = 1LL << 33;  // beyond is no time of day, and would not fit
    const bool a_time = header->ts.tv_sec >= 0 && header->ts.tv_sec < max_seconds && header->ts.tv_usec >= 0 &&
                        header->ts.tv_usec < ns_per_s;
    const TimeNs stamp = a_time ? header->ts.tv_sec * ns_per_s + header->ts.tv_usec : -1;  // precision: nanoseconds
    if (!first) first = stamp;
    if (!a_time || stamp < *first - ns_per_s || stamp - *first > LinkRecording::max_length)
      return Error{
          fmt::format("{}: packet {} is not of the same two days as the first: damaged, or of several captures", path,
                      packets + 1)};
    last = std::max(last, stamp - *first);  // of a step back
    const auto datagram = datagram_in(link_type, {reinterpret_cast<const char*>(bytes), header->caplen});
    if (!datagram) continue;
    if (const Status taken = listener.take(last, *datagram); !taken)
      return Error{fmt::format("{}: {}", path, taken.error().message)};
  }
  auto links = listener.links();
  if (links.empty())
    return Error{fmt::format("{}: no Tello in it: nothing goes to UDP port {}, and nobody is sent `command` at {}",
                             path, state_port, command_port)};
  return links;
}

Result<CapturedLink> link_of(const std::vector<CapturedLink>& links, const std::string& drone) {
  std::vector<std::string> there;
  for (const CapturedLink& link : links) {
    if (link.drone == drone || (drone.empty() && links.size() == 1)) return link;
    there.push_back(fmt::format("{} ({} states)", link.drone, link.states.size()));
  }
  return Error{fmt::format("{}; there are {}", drone.empty() ? "which drone is meant?" : "no drone " + drone,
                           fmt::join(there, ", "))};
}

}  // namespace ledgerline::hil
