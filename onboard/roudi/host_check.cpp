#include "onboard/roudi/host_check.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/sysmacros.h>
#include <unistd.h>
#include <sstream>

#include "common/base/file.hpp"
#include "onboard/ipc/ipc.hpp"

namespace ledgerline::roudi {

namespace {

// iceoryx 2 locks it for as long as a RouDi lives, so that there is one a machine.
constexpr const char* lock_file = "/tmp/iox-unique-roudi.lock";

std::string program_of(pid_t process) {
  const auto comm = read_file(fmt::format("/proc/{}/comm", process));
  std::string name = comm ? *comm : "";
  if (!name.empty() && name.back() == '\n') name.pop_back();
  return name;
}

}  // namespace

std::optional<pid_t> lock_holder(const std::string& locks, dev_t device, ino_t inode) {
  const std::string file = fmt::format("{:02x}:{:02x}:{}", major(device), minor(device), inode);
  std::istringstream lines(locks);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string number, kind, advisory, access, of_file;
    pid_t process = 0;
    if (words >> number >> kind >> advisory >> access >> process >> of_file && of_file == file && process > 0)
      return process;
  }
  return std::nullopt;
}

Error in_the_way(bool answers, std::optional<pid_t> holder, const std::string& program) {
  constexpr const char* both = "Where both are needed, give one of them a container with /tmp and /dev/shm of its own";
  if (holder) {
    return Error{
        fmt::format("another RouDi runs already on this machine, {} (process {}), and iceoryx has one a machine: stop "
                    "it first (kill {}, or systemctl stop its unit). {}",
                    program.empty() ? "a program that cannot be seen" : program, *holder, *holder, both)};
  }
  if (answers) {
    return Error{fmt::format(
        "another RouDi runs already on this machine, and iceoryx has one a machine: stop it first (`pgrep -af roudi` "
        "shows it). {}",
        both)};
  }
  return Error{
      "/tmp/roudi belongs to another user, and no RouDi is seen that lives: as root, rm /tmp/roudi /tmp/roudi.lock "
      "/tmp/iox-unique-roudi.lock /dev/shm/iceoryx_mgmt"};
}

Status check_no_other() {
  ipc::Peer peer = ipc::probe("roudi");
  // Memory has one name for both, and a new RouDi would take it from the one that serves.
  if (peer == ipc::Peer::gone && ipc::probe_service("roudi") != ipc::Peer::gone && ::geteuid() == 0)
    peer = ipc::Peer::alive;
  if (peer == ipc::Peer::gone) return ipc::check_names({"roudi", "roudi.lock", "iox-unique-roudi.lock"});
  struct stat info {};
  std::optional<pid_t> holder;
  const auto locks = read_file("/proc/locks");
  if (locks && ::stat(lock_file, &info) == 0) holder = lock_holder(*locks, info.st_dev, info.st_ino);
  return in_the_way(peer == ipc::Peer::alive, holder, holder ? program_of(*holder) : "");
}

namespace {

// iceoryx' management segment and our pools take 68 MB (66 of them fixed); 96 MB in all leaves room for others.
constexpr std::uint64_t min_size = 96ULL << 20;
constexpr std::uint64_t min_available = 72ULL << 20;

}  // namespace

Status check_shared_memory(std::uint64_t size, std::uint64_t available) {
  if (size < min_size) {
    return Error{fmt::format(
        "/dev/shm has {} MB, {} MB are needed: mount -o remount,size=128m /dev/shm (a container: docker run "
        "--shm-size=128m)",
        size >> 20, min_size >> 20)};
  }
  if (available < min_available) {
    return Error{fmt::format(
        "/dev/shm has {} MB free of {} MB, {} MB are needed: delete leftovers there, or stop what an earlier RouDi "
        "served",
        available >> 20, size >> 20, min_available >> 20)};
  }
  return done;
}

Status check_shared_memory() {
  struct statvfs info {};
  if (::statvfs("/dev/shm", &info) != 0)
    return Error{"there is no /dev/shm: mount a tmpfs on it (mount -t tmpfs -o size=128m tmpfs /dev/shm)"};
  const std::uint64_t block = info.f_frsize;
  return check_shared_memory(info.f_blocks * block, info.f_bavail * block);
}

}  // namespace ledgerline::roudi
