#include <arpa/inet.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <stdexcept>

#include "common/base/file.hpp"
#include "hil/netem/recording/capture.hpp"
#include "hil/netem/recording/link_recording.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/proxy/drone_side.hpp"
#include "hil/proxy/switches.hpp"
#include "tests/fuzz/directory.hpp"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/hil/netem/recording/captures.hpp"

/// What a person tells the proxy: commands with effects and distributions; captures and tables of recorded days.
namespace ledgerline::fuzz::hil_part {
namespace {

using hil::proxy::Switches;
using hil::proxy::Target;

const std::vector<std::string> commands{
    "drone tello1 to delay 200ms, loss 5%",
    "drone * both jitter gamma 0.46s 0.2s, duplicate 5% 20ms, reorder 5% normal 30ms 5ms",
    "drone tello1 from loss bursts 1% 20% 80% 0.1%, corrupt 1%, truncate 1%",
    "server agent both delay uniform 10ms 50ms, rate 20kB/s queue 8kB",
    "server * from stall",
    "server agent cut",
    "drone tello1 state partition off",
    "sensor tello1 bat bias -5",
    "sensor * all every 700ms",
    "clear",
};

/// A command that is taken is listed as commands that give the same again, and can be switched off where it may last.
Outcome command(std::string_view bytes) {
  const std::vector<Target> targets{{Target::Kind::drone, "tello1"}, {Target::Kind::server, "agent"}};
  Switches switches(targets);
  if (const auto applied = switches.apply(bytes); !applied) return refused(applied.error().message);
  const std::string list = switches.list();
  Switches again(targets);
  for (std::size_t begin = 0, end; (end = list.find('\n', begin)) != std::string::npos; begin = end + 1) {
    if (const auto applied = again.apply(std::string_view(list).substr(begin, end - begin)); !applied)
      return refused("");  // which the campaign takes for unclear
  }
  if (again.list() != list) return refused("");
  if (const auto off = hil::proxy::opposite(bytes)) (void)switches.apply(*off);
  return accepted();
}

const Registration commands_entry({"proxy.command", Kind::text,
                                   [] { return std::make_unique<Function>(commands, command); }});

constexpr TimeNs step = ns_per_ms;

/// 127.101.x.y with x of this process: entries of several run side by side.
sockaddr_in own_address(std::uint8_t last, std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(127U << 24 | 101U << 16 | static_cast<unsigned>(::getpid() % 256) << 8 | last);
  address.sin_port = htons(port);
  return address;
}

class Socket {
 public:
  Socket(int type, const sockaddr_in& at) : fd_(::socket(AF_INET, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)) {
    const int on = 1;
    ::setsockopt(fd_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (::bind(fd_, reinterpret_cast<const sockaddr*>(&at), sizeof at) != 0)
      throw std::runtime_error("cannot bind " + hil::proxy::address_text(at));
  }
  ~Socket() { ::close(fd_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  int fd() const { return fd_; }
  void send(const sockaddr_in& to, std::string_view bytes) const {
    ::sendto(fd_, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
  /// How many datagrams lie there; takes them off.
  int take_all() const {
    char byte = 0;
    int count = 0;
    while (::recv(fd_, &byte, 1, MSG_TRUNC) >= 0) ++count;
    return count;
  }

 private:
  int fd_;
};

/// Datagrams from a client, from the drone (answers and state) and from an outsider, as the first byte says; sensors
/// and lines are impaired by turns. What goes on to where it belongs is accepted.
class Datagrams final : public Entry {
 public:
  Datagrams()
      : client_(SOCK_DGRAM, own_address(3, 40'000)),
        client_state_(SOCK_DGRAM, own_address(3, state_port)),
        drone_(SOCK_DGRAM, own_address(2, command_port)),
        outsider_(SOCK_DGRAM, own_address(9, 40'000)) {
    auto side = hil::proxy::DroneSide::open({"tello1", own_address(1, 0).sin_addr, own_address(2, 0).sin_addr},
                                            own_address(4, 0).sin_addr, 1);
    auto shared = hil::proxy::SharedPorts::open(own_address(4, 0).sin_addr);
    if (!side || !shared) throw std::runtime_error(side ? shared.error().message : side.error().message);
    sides_.push_back(std::move(*side));
    shared_.emplace(std::move(*shared));
    talk(client_, own_address(1, command_port), "command");
  }
  std::vector<std::string> seeds() override {
    return {"ccommand", "crc 0 100 0 -100", "cport 1 2", "spitch:0;roll:0;yaw:0;tof:10;h:0;bat:100;agz:-999.00;\r\n",
            "xcommand"};
  }
  std::vector<std::string> probes() override { return {"ccommand", "crc 0 100 0 -100"}; }
  Outcome feed(std::string_view bytes) override {
    if (bytes.empty()) return dropped();
    const std::string_view rest = bytes.substr(1);
    auto fault = hil::parse_sensor(++turns_ % 2 == 0 ? "all garbage" : "h bias 5");
    fault->item = turns_;
    sides_[0].misreport({*fault});
    if (bytes[0] == 's') return talk(drone_, own_address(4, state_port), rest);
    if (bytes[0] == 'x') return talk(outsider_, own_address(4, state_port), rest);
    return talk(client_, own_address(1, command_port), rest);
  }

 private:
  Outcome talk(const Socket& from, const sockaddr_in& to, std::string_view bytes) {
    from.send(to, bytes);
    std::vector<pollfd> polled;
    sides_[0].add_to(polled);
    ::poll(polled.data(), polled.size(), 0);
    now_ += step;
    hil::proxy::receive_shared(shared_->state(), hil::proxy::Direction::state, now_, sides_);
    sides_[0].receive(now_, polled);
    sides_[0].send(now_);
    return drone_.take_all() + client_.take_all() + client_state_.take_all() > 0 ? accepted() : dropped();
  }

  Socket client_, client_state_, drone_, outsider_;
  std::vector<hil::proxy::DroneSide> sides_;
  std::optional<hil::proxy::SharedPorts> shared_;
  std::size_t turns_ = 0;
  TimeNs now_ = ns_per_s;
};

const Registration datagrams_entry({"proxy.datagrams", Kind::bytes, [] { return std::make_unique<Datagrams>(); },
                                    0.05});

/// A capture or a table, from a file.
class DayFile final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    std::vector<hil::Packet> packets{hil::said_at(0, "command"), hil::answer_at(5 * ns_per_ms, "ok")};
    for (int i = 0; i < 6; ++i) packets.push_back(hil::state_at((10 + i * 100) * ns_per_ms));
    hil::write_capture(path_, packets);
    auto capture = read_file(path_);
    if (!capture) throw std::runtime_error(capture.error().message);
    return {*capture, "seconds,delay_s\n0,0.1\n0.1,lost\n0.2,0.3\n"};
  }
  Outcome feed(std::string_view bytes) override {
    if (const Status written = write_file(path_, bytes); !written) throw std::runtime_error(written.error().message);
    const auto day = hil::read_link_recording(path_);
    if (!day) return refused(day.error().message);
    for (const TimeNs at : {TimeNs{0}, (*day)->length_ns() / 2, (*day)->length_ns()}) {
      if ((*day)->at(at).delay_ns < 0 || (*day)->at(at).delay_ns > hil::max_delay) return refused("");
    }
    return accepted();
  }

 private:
  Directory directory_;
  const std::string path_ = directory_.path + "/day";
};

const Registration day_entry({"recording.day", Kind::bytes, [] { return std::make_unique<DayFile>(); }});

Outcome captured(std::string_view bytes) {
  const auto datagram = hil::datagram_in(DLT_EN10MB, bytes);
  if (!datagram) return dropped();
  const auto inside = [&](std::string_view part) {
    return part.empty() || (part.data() >= bytes.data() && part.data() + part.size() <= bytes.data() + bytes.size());
  };
  return inside(datagram->payload) ? accepted() : refused("");
}

const Registration packet_entry({"recording.packet", Kind::bytes, [] {
                                   return std::make_unique<Function>(
                                       std::vector<std::string>{hil::ethernet_frame(hil::state_at(0))}, captured);
                                 }});

/// What a client and a drone say goes through faults of every kind; the first byte says which of both it is.
class SdkCalls final : public Entry {
 public:
  SdkCalls() : faults_(1, 2) {
    std::vector<hil::SdkFault> all;
    for (const char* text : {"answers late 10ms 30%", "answers wrong 30% to land", "answers garbage 10%",
                             "answers missing 10%", "answers twice 5ms 30%", "answers other 30%", "answers shifted 10%",
                             "states torn 50%", "states stale 30%", "states other 30%"}) {
      all.push_back(*hil::parse_sdk_fault(text));
      all.back().item = all.size();
    }
    if (!faults_.set(0, std::move(all))) throw std::runtime_error("faults are refused");
  }
  std::vector<std::string> seeds() override {
    return {"ccommand", "crc 0 0 0 0", "cbattery?", "aok", "aerror Motor stop", "spitch:0;h:0;bat:87;\r\n"};
  }
  std::vector<std::string> probes() override { return {"spitch:0;h:0;bat:87;\r\n"}; }
  Outcome feed(std::string_view bytes) override {
    if (bytes.empty()) return dropped();
    now_ += step;
    const std::string_view rest = bytes.substr(1);
    if (bytes[0] == 'c') {
      faults_.command(now_, 0, rest);
    } else if (bytes[0] == 's') {
      faults_.state(now_, 1, "pitch:0;h:0;bat:87;\r\n");
      faults_.state(now_, 0, rest);
    } else {
      faults_.answer(now_, 0, rest);
    }
    bool came = false;
    while (faults_.pop(now_)) came = true;
    return came ? accepted() : dropped();
  }

 private:
  hil::SdkFaults faults_;
  TimeNs now_ = 0;
};

const Registration sdk_entry({"sdk.calls", Kind::bytes, [] { return std::make_unique<SdkCalls>(); }});

Outcome sdk_fault(std::string_view bytes) {
  const auto fault = hil::parse_sdk_fault(bytes);
  if (!fault) return refused(fault.error().message);
  const auto again = hil::parse_sdk_fault(hil::text_of(*fault));
  return again && hil::text_of(*again) == hil::text_of(*fault) ? accepted() : refused("");
}

const Registration sdk_fault_entry({"sdk.fault", Kind::text, [] {
                                      return std::make_unique<Function>(
                                          std::vector<std::string>{"answers late 300ms 30% to takeoff",
                                                                   "answers shifted", "answers twice 700ms",
                                                                   "states torn 30%"},
                                          sdk_fault);
                                    }});

}  // namespace
}  // namespace ledgerline::fuzz::hil_part
