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
#include <sys/utsname.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

#include "common/base/file.hpp"
#include "common/process/children.hpp"
#include "tools/checks/shell/host_probe.hpp"

namespace ledgerline::launcher {
namespace {

namespace fs = std::filesystem;

const char* const roudi_socket = "/tmp/roudi";  // iceoryx 2.0: a datagram socket that answers while a RouDi lives

// RouDi's segments: its own, and one named after the group that may use it.
std::vector<fs::path> roudi_leftovers() {
  std::vector<fs::path> files{"/dev/shm/iceoryx_mgmt", roudi_socket};
  if (const group* own = ::getgrgid(::getegid())) files.push_back(fs::path("/dev/shm") / own->gr_name);
  std::error_code error;
  std::erase_if(files, [&](const fs::path& f) { return !fs::exists(fs::symlink_status(f, error)); });
  return files;
}

void check_shared_memory(checks::Findings& findings, std::vector<std::string>& notes) {
  constexpr const char* check = "roudi";
  using Roudi = checks::SharedMemoryInputs::Roudi;
  const Roudi roudi = checks::probe_shared_memory().roudi;
  if (roudi == Roudi::alive || roudi == Roudi::forbidden) {
    findings.push_back(roudi == Roudi::alive ? flag(checks::Problem::roudi_runs, check, "on this machine")
                                             : flag(checks::Problem::roudi_foreign, check, "of another user"));
    return;
  }
  for (const fs::path& file : roudi_leftovers()) {
    std::error_code error;
    if (fs::remove(file, error))
      notes.push_back(fmt::format("removed {}, left by a RouDi that is gone", file.string()));
    else
      findings.push_back(flag(checks::Problem::roudi_left, check, file.string() + ", another user's",
                              fmt::format("sudo rm {}", file.string())));
  }
  add(findings, checks::assess_place(checks::probe_shared_memory()));
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

}  // namespace

Result<RunLock> RunLock::acquire(const std::string& file, const std::string& about) {
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

int free_port(const std::string& address) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  socklen_t size = sizeof at;
  const bool bound = fd >= 0 && ::inet_pton(AF_INET, address.c_str(), &at.sin_addr) == 1 &&
                     ::bind(fd, reinterpret_cast<const sockaddr*>(&at), size) == 0 &&
                     ::getsockname(fd, reinterpret_cast<sockaddr*>(&at), &size) == 0;
  if (fd >= 0) ::close(fd);
  return bound ? ntohs(at.sin_port) : 0;
}

std::string address_of(int drone) { return fmt::format("127.0.0.{}", drone + 1); }

checks::Findings check_machine(int drones, std::vector<std::string>& notes) {
  checks::Findings findings;
  check_shared_memory(findings, notes);
  check_multicast(notes);
  for (int k = 0; k <= drones; ++k) {
    checks::PortInputs port = checks::probe_port(k == 0 ? "127.0.0.1:8890" : address_of(k) + ":8889");
    port.is_links = k == 0;
    if (checks::Finding one = assess(port); one.problem) findings.push_back(std::move(one));
  }
  return findings;
}

void remove_roudi_leftovers() {
  using Roudi = checks::SharedMemoryInputs::Roudi;
  const Roudi roudi = checks::probe_shared_memory().roudi;
  if (roudi == Roudi::alive || roudi == Roudi::forbidden) return;
  std::error_code error;  // another user's stay: the next flight's check names them
  for (const fs::path& file : roudi_leftovers()) fs::remove(file, error);
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

namespace {

constexpr int max_descriptors = 1'024;

[[noreturn]] void become(const char* program, const char* argument) {
  ::setsid();  // the flight's Ctrl-C is not the browser's
  if (::fork() != 0) ::_exit(0);
  struct sigaction usual {};
  usual.sa_handler = SIG_DFL;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) ::sigaction(signal, &usual, nullptr);
  const int nothing = ::open("/dev/null", O_RDWR);
  for (int fd = 0; fd < 3; ++fd) ::dup2(nothing, fd);
  for (int fd = 3; fd < max_descriptors; ++fd) ::close(fd);
  ::execl(program, program, argument, nullptr);
  ::_exit(127);
}

}  // namespace

Status open_in_browser(const std::string& url, const std::string& file) {
  const std::string program = find_program("xdg-open");
  if (program.empty()) return Error{"there is no xdg-open here"};
  const std::string page = fmt::format(
      "<!doctype html><meta charset=utf-8><meta name=referrer content=no-referrer>"
      "<meta http-equiv=refresh content=\"0;url={0}\"><title>Ledgerline</title><a href=\"{0}\">To the page</a>\n",
      url);
  if (auto written = replace_file(file, page, 0600); !written) return written;
  const pid_t child = ::fork();
  if (child == 0) become(program.c_str(), file.c_str());
  if (child < 0) return Error{fmt::format("xdg-open is not started: {}", std::strerror(errno))};
  while (::waitpid(child, nullptr, 0) < 0 && errno == EINTR) {
  }
  return done;
}

}  // namespace ledgerline::launcher
