#include "tools/checks/shell/host_probe.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/timex.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "common/base/file.hpp"
#include "common/process/usage.hpp"
#include "onboard/ipc/roudi_probe.hpp"
#include "onboard/roudi/host_check.hpp"

namespace ledgerline::checks {
namespace {

namespace fs = std::filesystem;

constexpr const char* link_units[] = {"/etc/systemd/system/ledgerline-link.service",
                                      "/lib/systemd/system/ledgerline-link.service",
                                      "/usr/local/lib/systemd/system/ledgerline-link.service"};

constexpr const char* roudi_units[] = {"/etc/systemd/system/ledgerline-roudi.service",
                                       "/lib/systemd/system/ledgerline-roudi.service",
                                       "/usr/local/lib/systemd/system/ledgerline-roudi.service"};

std::string first_line(const fs::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

struct Owner {
  std::string program{};  ///< empty: /proc does not show it to this user
  int pid = 0;
};

/// The process that has a socket, "socket:[INODE]".
Owner owner_of(const std::string& wanted) {
  std::error_code error;
  for (const auto& process : fs::directory_iterator("/proc", error)) {
    const std::string pid = process.path().filename();
    if (pid.find_first_not_of("0123456789") != std::string::npos) continue;
    for (fs::directory_iterator fd(process.path() / "fd", error), end; !error && fd != end; fd.increment(error)) {
      std::error_code unreadable;
      if (fs::read_symlink(fd->path(), unreadable) == wanted)
        return {first_line(process.path() / "comm"), std::atoi(pid.c_str())};
    }
  }
  return {};
}

/// The program that has a Unix socket of this path, as far as /proc shows it to this user.
std::string program_of(const std::string& socket_path) {
  std::ifstream table("/proc/net/unix");
  std::string line, wanted;
  while (std::getline(table, line)) {
    std::istringstream words(line);
    std::string word, inode, path;
    for (int i = 0; i < 7 && words >> word; ++i) inode = word;
    if (words >> path && path == socket_path) wanted = "socket:[" + inode + "]";
  }
  return wanted.empty() ? "" : owner_of(wanted).program;
}

/// Who has the UDP port, by the table of this network.
Owner owner_of_udp(unsigned port) {
  std::ifstream table("/proc/net/udp");
  std::string line;
  while (std::getline(table, line)) {
    std::istringstream words(line);
    std::string word, local;
    words >> word >> local;
    for (int i = 2; i < 10 && words >> word; ++i) {
    }
    const std::size_t colon = local.find(':');
    if (colon == std::string::npos || local.substr(colon + 1) != fmt::format("{:04X}", port)) continue;
    return owner_of("socket:[" + word + "]");
  }
  return {};
}

/// In a child, so that doctor stays as it is.
bool permitted(int (*ask)()) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(ask() == 0 ? 0 : 1);
  int status = 1;
  return child > 0 && ::waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

int try_fifo() {
  sched_param param{};
  param.sched_priority = 80;  // link's
  return ::sched_setscheduler(0, SCHED_FIFO, &param);
}
int try_lock() { return ::mlockall(MCL_CURRENT | MCL_FUTURE); }

/// By VmLck of /proc/PID/status, in kB.
bool locks_memory(int process) {
  std::ifstream status(fmt::format("/proc/{}/status", process));
  std::string word;
  while (status >> word) {
    if (word == "VmLck:") return status >> word && word != "0";
  }
  return false;
}

std::string interface_with(const in_addr& address) {
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return "";
  std::string name;
  for (const ifaddrs* one = all; one; one = one->ifa_next) {
    if (!one->ifa_addr || one->ifa_addr->sa_family != AF_INET) continue;
    if (reinterpret_cast<const sockaddr_in*>(one->ifa_addr)->sin_addr.s_addr == address.s_addr) name = one->ifa_name;
    // All of 127.0.0.0/8 is on it, though it has one address.
    if (name.empty() && (one->ifa_flags & IFF_LOOPBACK) != 0 && (ntohl(address.s_addr) >> 24) == IN_LOOPBACKNET)
      name = one->ifa_name;
  }
  ::freeifaddrs(all);
  return name;
}

/// Whether an address is of the interface's own network.
bool is_beside(const std::string& interface, const in_addr& address) {
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return false;
  bool beside = false;
  for (const ifaddrs* one = all; one; one = one->ifa_next) {
    if (interface != one->ifa_name || !one->ifa_addr || one->ifa_addr->sa_family != AF_INET || !one->ifa_netmask)
      continue;
    const in_addr_t own = reinterpret_cast<const sockaddr_in*>(one->ifa_addr)->sin_addr.s_addr;
    const in_addr_t mask = reinterpret_cast<const sockaddr_in*>(one->ifa_netmask)->sin_addr.s_addr;
    beside = beside || ((own ^ address.s_addr) & mask) == 0;
  }
  ::freeifaddrs(all);
  return beside;
}

}  // namespace

DirectoryInputs probe_directory(const std::string& file) {
  fs::path folder = fs::absolute(file).parent_path();
  DirectoryInputs inputs{.path = folder};
  inputs.writable = ::access(folder.c_str(), W_OK | X_OK) == 0;
  inputs.read_only = !inputs.writable && errno == EROFS;
  if (auto space = space_at(folder)) inputs.free_bytes = space->available;
  return inputs;
}

ClockInputs probe_clock() {
  timex clock{};
  const int state = ::adjtimex(&clock);
  if (state < 0) return {};
  const bool synchronised = state != TIME_ERROR && (clock.status & STA_UNSYNC) == 0;
  return {.known = true, .synchronised = synchronised, .max_error_ms = static_cast<double>(clock.maxerror) * 1e-3};
}

RealTimeInputs probe_real_time(bool wanted, int link) {
  RealTimeInputs inputs{.wanted = wanted, .link = link};
  if (link != 0) {
    for (const ThreadUsage& thread : read_threads("link", link))
      inputs.fifo = inputs.fifo || thread.policy == SCHED_FIFO;
    inputs.locked = locks_memory(link);
    return inputs;
  }
  for (const char* unit : link_units)
    if (inputs.unit.empty() && ::access(unit, R_OK) == 0) inputs.unit = unit;
  inputs.fifo = permitted(try_fifo);
  inputs.locked = permitted(try_lock);
  return inputs;
}

SharedMemoryInputs probe_shared_memory() {
  constexpr const char* name = "roudi";
  const std::string path = std::string("/tmp/") + name;
  SharedMemoryInputs inputs;
  using Roudi = SharedMemoryInputs::Roudi;
  ipc::Peer peer = ipc::probe(name);
  if (peer == ipc::Peer::gone) peer = ipc::probe_service(name);
  switch (peer) {
    case ipc::Peer::alive:
      inputs.roudi = Roudi::alive;
      break;
    case ipc::Peer::forbidden:
      inputs.roudi = Roudi::forbidden;
      break;
    case ipc::Peer::gone:
      inputs.roudi = ipc::socket_inode(name) != 0 ? Roudi::left : Roudi::none;
      break;
  }
  if (inputs.roudi == Roudi::alive) {
    inputs.program = program_of(path);
    inputs.left_behind = ipc::older_than_roudi({"ledgerline-link", "ledgerline-agent"});
  }
  if (auto room = roudi::check_shared_memory(); !room) inputs.no_room = room.error().message;
  if (auto writable = roudi::check_writable(); !writable) inputs.not_writable = writable.error().message;
  const roudi::UserGroup of = roudi::group_of_process();
  if (auto served = roudi::check_group(of); !served) inputs.group_unusable = served.error().message;
  inputs.group_shared = roudi::warn_of_others(of);
  for (const char* unit : roudi_units) inputs.by_unit = inputs.by_unit || ::access(unit, R_OK) == 0;
  return inputs;
}

PortInputs probe_port(const std::string& listen) {
  PortInputs inputs{.listen = listen};
  const std::size_t colon = listen.rfind(':');
  sockaddr_in at{};
  at.sin_family = AF_INET;
  const unsigned port = colon == std::string::npos ? 0 : static_cast<unsigned>(std::atoi(listen.c_str() + colon + 1));
  at.sin_port = htons(static_cast<std::uint16_t>(port));
  if (port == 0 || ::inet_pton(AF_INET, listen.substr(0, colon).c_str(), &at.sin_addr) != 1) {
    inputs.why = "not an IPv4 address with a port";
    return inputs;
  }
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const int error = fd >= 0 && ::bind(fd, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0 ? 0 : errno;
  if (fd >= 0) ::close(fd);
  inputs.taken = error == EADDRINUSE;
  if (error != 0 && !inputs.taken) inputs.why = std::strerror(error);
  if (!inputs.taken) return inputs;
  const Owner owner = owner_of_udp(port);
  inputs.program = owner.program;
  inputs.pid = owner.pid;
  return inputs;
}

InterfaceInputs probe_interface(const std::string& name, const std::string& whose) {
  InterfaceInputs inputs{.name = name, .whose = whose};
  inputs.there = ::if_nametoindex(name.c_str()) != 0;
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return inputs;
  for (const ifaddrs* one = all; one; one = one->ifa_next) {
    if (name != one->ifa_name) continue;
    inputs.up = inputs.up || ((one->ifa_flags & IFF_UP) != 0 && (one->ifa_flags & IFF_RUNNING) != 0);
    inputs.has_address = inputs.has_address || (one->ifa_addr && one->ifa_addr->sa_family == AF_INET);
  }
  ::freeifaddrs(all);
  return inputs;
}

RouteInputs probe_route(const std::string& drone, const std::string& address, const std::string& wanted) {
  RouteInputs inputs{drone, address, wanted};
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(8889);
  if (::inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1) {
    inputs.why = "it is no IPv4 address";
    return inputs;
  }
  // link binds to the interface, so its own network counts before the routing table, which names one of two that have
  // the same.
  if (!wanted.empty() && is_beside(wanted, to.sin_addr)) {
    inputs.over = wanted;
    return inputs;
  }
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in from{};
  socklen_t size = sizeof from;
  if (fd < 0 || ::connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0 ||
      ::getsockname(fd, reinterpret_cast<sockaddr*>(&from), &size) != 0) {
    inputs.why = std::strerror(errno);
  } else {
    inputs.over = interface_with(from.sin_addr);
    if (inputs.over.empty()) inputs.why = "no interface has the address that it would be sent from";
  }
  if (fd >= 0) ::close(fd);
  return inputs;
}

bool is_link_running() {
  constexpr const char* name = "ledgerline-link";
  return ipc::probe(name) == ipc::Peer::alive || ipc::probe_service(name) == ipc::Peer::alive;
}

}  // namespace ledgerline::checks
