#include "hil/fault/real/machine.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mount.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;
constexpr const char* small_disk = "size=256m";  // the ledger of a flight of some minutes

}  // namespace

std::vector<pid_t> descendants(pid_t parent, const std::string& program) {
  std::map<pid_t, pid_t> parents;
  std::map<pid_t, std::string> programs;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    const std::string text = entry.path().filename();
    pid_t pid = 0;
    if (std::from_chars(text.data(), text.data() + text.size(), pid).ec != std::errc()) continue;
    std::ifstream file(entry.path() / "stat");
    std::string stat(std::istreambuf_iterator<char>(file), {});
    const std::size_t name_end = stat.rfind(')');
    if (name_end == std::string::npos || name_end + 4 > stat.size()) continue;
    parents[pid] = std::atoi(stat.c_str() + name_end + 4);  // ") S PARENT"
    std::error_code gone;
    programs[pid] = fs::read_symlink(entry.path() / "exe", gone).filename();
  }
  std::vector<pid_t> found;
  for (const auto& [pid, name] : programs) {
    if (name != program) continue;
    pid_t up = pid;
    for (int i = 0; i < 20 && up > 1 && up != parent; ++i) up = parents.contains(up) ? parents[up] : 0;
    if (up == parent) found.push_back(pid);
  }
  return found;
}

std::uint64_t available_memory() {
  std::ifstream file("/proc/meminfo");
  std::string key;
  for (std::uint64_t kilobytes = 0; file >> key >> kilobytes; file.ignore(100, '\n')) {
    if (key == "MemAvailable:") return kilobytes * 1'024;
  }
  return 0;
}

CpuLoad::CpuLoad(int core)
    : thread_([](const std::stop_token& stop) {
        volatile std::uint64_t count = 0;
        while (!stop.stop_requested()) {
          for (int i = 0; i < 100'000; ++i) count = count + 1;
        }
      }) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(core), &set);
  pinned_ = ::pthread_setaffinity_np(thread_.native_handle(), sizeof set, &set) == 0;
}
SmallDisk::~SmallDisk() {
  if (!directory_.empty()) ::umount2(directory_.c_str(), MNT_DETACH);
}

Status SmallDisk::mount(const std::string& directory) {
  std::error_code error;
  fs::create_directories(directory, error);
  if (error) return Error{fmt::format("cannot make {}: {}", directory, error.message())};
  if (::unshare(CLONE_NEWNS) != 0 || ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      ::mount("none", directory.c_str(), "tmpfs", 0, small_disk) != 0)
    return Error{
        fmt::format("`disk full` needs a file system of its own for the ledger: {}. Run it as root, or in a user "
                    "namespace (unshare -Urm)",
                    std::strerror(errno))};
  directory_ = directory;
  return done;
}

Status fill(const std::string& path) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  if (fd < 0) return Error{fmt::format("cannot make {}: {}", path, std::strerror(errno))};
  const std::string bytes(1 << 20, 'x');
  while (::write(fd, bytes.data(), bytes.size()) > 0) {
  }
  const int why = errno;
  ::close(fd);
  if (why != ENOSPC) return Error{fmt::format("cannot fill {}: {}", path, std::strerror(why))};
  return done;
}

}  // namespace ledgerline::hil
