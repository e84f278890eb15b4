#include "tools/launcher/machine.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <grp.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/timex.h>
#include <sys/un.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

namespace ledgerline::fly {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t shared_memory_needed = 96ULL << 20;  // iceoryx's own 66 MB, our pools, and some room
constexpr std::uint16_t command_port = 8889;
constexpr std::uint16_t state_port = 8890;
const char* const roudi_socket = "/tmp/roudi";  // iceoryx 2.0: a datagram socket that answers while a RouDi lives

// Where systemd runs it (packaging/systemd): a /tmp of its own, but the machine's shared memory.
const char* const service_roudi_socket = "/run/ledgerline/roudi";

bool answers(const char* path) {
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_un name{};
  name.sun_family = AF_UNIX;
  std::strncpy(name.sun_path, path, sizeof name.sun_path - 1);
  const bool lives = fd >= 0 && ::connect(fd, reinterpret_cast<sockaddr*>(&name), sizeof name) == 0;
  if (fd >= 0) ::close(fd);
  return lives;
}

bool roudi_lives() {
  return answers(roudi_socket) || (::access("/dev/shm/iceoryx_mgmt", F_OK) == 0 && answers(service_roudi_socket));
}

// RouDi's segments: its own, and one named after the group that may use it.
std::vector<fs::path> roudi_leftovers() {
  std::vector<fs::path> files{"/dev/shm/iceoryx_mgmt", roudi_socket};
  if (const group* own = ::getgrgid(::getegid())) files.push_back(fs::path("/dev/shm") / own->gr_name);
  std::error_code error;
  std::erase_if(files, [&](const fs::path& f) { return !fs::exists(fs::symlink_status(f, error)); });
  return files;
}

void check_shared_memory(std::vector<Problem>& problems, std::vector<std::string>& notes) {
  if (roudi_lives()) {
    problems.push_back(
        {"another RouDi (the broker of shared memory) runs on this machine", "end it: `pgrep -af roudi` shows it"});
    return;
  }
  for (const fs::path& file : roudi_leftovers()) {
    std::error_code error;
    if (fs::remove(file, error)) {
      notes.push_back(fmt::format("removed {}, left by a RouDi that is gone", file.string()));
    } else {
      problems.push_back({fmt::format("{} was left by another user's RouDi", file.string()),
                          fmt::format("sudo rm {}", file.string())});
    }
  }
  struct statvfs info {};
  if (::statvfs("/dev/shm", &info) != 0) {
    problems.push_back({"there is no /dev/shm", "mount -t tmpfs -o size=256m tmpfs /dev/shm"});
    return;
  }
  const std::uint64_t free = static_cast<std::uint64_t>(info.f_bavail) * info.f_frsize;
  if (free < shared_memory_needed) {
    problems.push_back({fmt::format("/dev/shm has {} MB free, 96 MB are needed", free >> 20),
                        "mount -o remount,size=256m /dev/shm (in a container: start it with --shm-size=256m)"});
  }
}

void check_multicast(std::vector<std::string>& notes) {
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return;
  bool multicast = true;
  for (const ifaddrs* i = all; i; i = i->ifa_next) {
    if ((i->ifa_flags & IFF_LOOPBACK) != 0) multicast = (i->ifa_flags & IFF_MULTICAST) != 0;
  }
  ::freeifaddrs(all);
  if (!multicast) {
    notes.push_back(
        "the loopback interface has no multicast: flights work without; for ROS 2 nodes of other kinds on this "
        "machine: ip link "
        "set lo multicast on");
  }
}

// "ledgerline-sim (process 123)", as far as /proc shows it to us.
std::string holder_of(const std::string& address, std::uint16_t port) {
  in_addr ip{};
  ::inet_pton(AF_INET, address.c_str(), &ip);
  std::ifstream table("/proc/net/udp");
  std::string line, inode;
  while (std::getline(table, line)) {
    unsigned number = 0, local = 0, local_port = 0, uid = 0;
    unsigned long node = 0;
    if (std::sscanf(line.c_str(), " %u: %X:%X %*X:%*X %*X %*X:%*X %*X:%*X %*X %u %*u %lu", &number, &local, &local_port,
                    &uid, &node) == 5 &&
        local_port == port && (local == ip.s_addr || local == 0)) {
      inode = fmt::format("socket:[{}]", node);
    }
  }
  std::error_code error;
  for (const auto& process : fs::directory_iterator("/proc", error)) {
    const std::string pid = process.path().filename();
    if (inode.empty() || pid.find_first_not_of("0123456789") != std::string::npos) continue;
    for (const auto& fd : fs::directory_iterator(process.path() / "fd", error)) {
      if (fs::read_symlink(fd.path(), error).string() != inode) continue;
      std::ifstream comm(process.path() / "comm");
      std::string name;
      std::getline(comm, name);
      return fmt::format("{} (process {})", name, pid);
    }
  }
  return "another process";
}

void check_port(const std::string& address, std::uint16_t port, std::vector<Problem>& problems) {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in name{};
  name.sin_family = AF_INET;
  name.sin_port = htons(port);
  ::inet_pton(AF_INET, address.c_str(), &name.sin_addr);
  if (fd < 0 || ::bind(fd, reinterpret_cast<sockaddr*>(&name), sizeof name) != 0) {
    const int why = errno;
    problems.push_back(
        {fmt::format("UDP {}:{} cannot be used: {}", address, port,
                     why == EADDRINUSE ? "it is taken by " + holder_of(address, port) : std::strerror(why)),
         why == EADDRINUSE ? "end that process" : "ip link set lo up"});
  }
  if (fd >= 0) ::close(fd);
}

}  // namespace

Result<RunLock> RunLock::take(const std::string& file, const std::string& about) {
  // Not close-on-exec: see above. Another user's file can be locked read-only. Anybody may put something else there:
  // no link is followed, no pipe is waited for.
  constexpr int careful = O_NOFOLLOW | O_NONBLOCK;
  int fd = ::open(file.c_str(), O_RDWR | O_CREAT | careful, 0644);
  if (fd < 0) fd = ::open(file.c_str(), O_RDONLY | careful);
  if (fd < 0) return Error{fmt::format("cannot open {}: {}", file, std::strerror(errno))};
  struct stat info {};
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode) || info.st_nlink != 1) {
    ::close(fd);
    return Error{fmt::format("{} is not a plain file with one name: remove it", file)};
  }
  const bool ours = info.st_uid == ::geteuid() && (::fcntl(fd, F_GETFL) & O_ACCMODE) == O_RDWR;
  // The last process of a flight that was killed may be ending just now.
  constexpr int tries = 20;
  int held = -1;
  for (int i = 0; i < tries && held != 0; ++i) {
    if (i > 0) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    held = ::flock(fd, LOCK_EX | LOCK_NB);
  }
  if (held != 0) {
    char text[1024] = {};
    const ssize_t n = ::pread(fd, text, sizeof text - 1, 0);
    ::close(fd);
    return Error{fmt::format("a flight is already in progress: {}. Wait for it, or end it with Ctrl-C there",
                             n > 0 ? text : "its process is not known")};
  }
  if (ours && (::ftruncate(fd, 0) != 0 || ::pwrite(fd, about.data(), about.size(), 0) < 0)) {
    const int why = errno;
    ::close(fd);
    return Error{fmt::format("cannot write {}: {}", file, std::strerror(why))};
  }
  return RunLock(fd);
}

RunLock::~RunLock() {
  if (fd_ >= 0) ::close(fd_);
}

int free_port() {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof at;
  const bool bound = fd >= 0 && ::bind(fd, reinterpret_cast<const sockaddr*>(&at), size) == 0 &&
                     ::getsockname(fd, reinterpret_cast<sockaddr*>(&at), &size) == 0;
  if (fd >= 0) ::close(fd);
  return bound ? ntohs(at.sin_port) : 0;
}

std::string address_of(int drone) { return fmt::format("127.0.0.{}", drone + 1); }

std::vector<Problem> check_machine(int drones, std::vector<std::string>& notes) {
  std::vector<Problem> problems;
  check_shared_memory(problems, notes);
  check_multicast(notes);
  for (int k = 1; k <= drones; ++k) check_port(address_of(k), command_port, problems);
  check_port("127.0.0.1", state_port, problems);
  return problems;
}

void remove_roudi_leftovers() {
  if (roudi_lives()) return;
  std::error_code error;  // another user's stay: the next flight's check names them
  for (const fs::path& file : roudi_leftovers()) fs::remove(file, error);
}

ClockFacts read_kernel_clock() {
  timex clock{};
  const int state = ::adjtimex(&clock);
  if (state < 0) return {};
  const bool synchronised = state != TIME_ERROR && (clock.status & STA_UNSYNC) == 0;
  return {.known = true, .synchronised = synchronised, .max_error_ms = static_cast<double>(clock.maxerror) * 1e-3};
}

Machine describe_machine() {
  utsname kernel{};
  ::uname(&kernel);
  Machine machine;
  machine.cpu = kernel.machine;
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.rfind("model name", 0) != 0) continue;
    machine.cpu = line.substr(line.find(':') + 2);
    break;
  }
  machine.system = fmt::format("{} {}", kernel.sysname, kernel.release);
  machine.cores = std::thread::hardware_concurrency();
  machine.memory_gb =
      static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1e9;
  return machine;
}

}  // namespace ledgerline::fly
