#include "onboard/roudi/host_check.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <grp.h>
#include <pwd.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/sysmacros.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <sstream>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "onboard/ipc/roudi_probe.hpp"

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

// Of a name that iceoryx 2.0 takes for a file.
constexpr const char* plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-.:_";
// Longer ones it cuts.
constexpr std::size_t max_name = 100;

bool is_plain(const std::string& name) {
  return name.size() <= max_name && name.back() != '.' && name.find_first_not_of(plain) == std::string::npos;
}

// As iceoryx asks, and so many groups at most.
bool is_in_group(const std::string& user, gid_t primary, gid_t group) {
  std::vector<gid_t> groups(888);
  int count = static_cast<int>(groups.size());
  if (::getgrouplist(user.c_str(), primary, groups.data(), &count) < 0) return primary == group;
  groups.resize(static_cast<std::size_t>(count));
  return std::find(groups.begin(), groups.end(), group) != groups.end();
}

// Whose primary group it is. The file alone: a directory service may have tens of thousands.
void add_primary_members(UserGroup& of) {
  std::FILE* const file = std::fopen("/etc/passwd", "re");
  if (!file) return;
  while (const passwd* one = ::fgetpwent(file)) {
    if (one->pw_gid == of.group && one->pw_uid != of.user) of.others.emplace_back(one->pw_name);
  }
  std::fclose(file);
}

}  // namespace

UserGroup group_of_process() {
  UserGroup of{.user = ::geteuid(), .group = ::getegid()};
  if (const passwd* user = ::getpwuid(of.user)) {
    of.user_name = user->pw_name;
    of.is_member = is_in_group(of.user_name, user->pw_gid, of.group);
  }
  if (const group* own = ::getgrgid(of.group)) {
    of.group_name = own->gr_name;
    for (char** member = own->gr_mem; *member; ++member) {
      if (of.user_name != *member) of.others.emplace_back(*member);
    }
  }
  add_primary_members(of);
  std::sort(of.others.begin(), of.others.end());
  of.others.erase(std::unique(of.others.begin(), of.others.end()), of.others.end());
  return of;
}

Status check_group(const UserGroup& of) {
  constexpr const char* why = "iceoryx names its shared memory after the group of its user, and finds both by name";
  if (of.user_name.empty()) {
    return Error{fmt::format(
        "user {0} has no entry in /etc/passwd, and {1}: add one (useradd --uid {0} NAME; in a container's image: echo "
        "'NAME:x:{0}:{2}::/:/bin/sh' >> /etc/passwd), or start as a user who has one",
        of.user, why, of.group)};
  }
  if (of.group_name.empty()) {
    return Error{fmt::format(
        "group {0} has no entry in /etc/group, and {1}: add one (groupadd --gid {0} NAME; in a container's image: echo "
        "'NAME:x:{0}:' >> /etc/group), or start with a group that has one",
        of.group, why)};
  }
  const std::string user = printable(of.user_name);
  if (!is_plain(of.group_name)) {
    return Error{fmt::format(
        "group {} has the name \"{}\", which iceoryx does not take for shared memory (letters, digits and -.:_ alone): "
        "start with another group that the user is in (`id -Gn` shows them) by sg GROUP -c PROGRAM, or with a new one: "
        "groupadd ledgerline; gpasswd -a {} ledgerline",
        of.group, printable(of.group_name), user)};
  }
  if (!of.is_member) {
    return Error{fmt::format(
        "user {0} is not in group {1} by the system's entries, and iceoryx gives it no memory: gpasswd -a {0} {1}, or "
        "start with a group that the user is in",
        user, of.group_name)};
  }
  return done;
}

std::string warn_of_others(const UserGroup& of) {
  if (of.others.empty()) return "";
  constexpr std::size_t max_names = 5;
  std::string names;
  for (std::size_t i = 0; i < of.others.size() && i < max_names; ++i)
    names += (i > 0 ? ", " : "") + printable(of.others[i]);
  if (of.others.size() > max_names) names += fmt::format(" and {} more", of.others.size() - max_names);
  return fmt::format("group {} has other users ({}), who may write to the memory that drones are flown by",
                     printable(of.group_name), names);
}

namespace {

// iceoryx' management segment and our pools take 68 MB (66 of them fixed); 96 MB in all leaves room for others.
constexpr std::uint64_t min_size = 96ULL << 20;
constexpr std::uint64_t min_available = 72ULL << 20;

}  // namespace

Status check_writable(bool writable, bool read_only, mode_t mode) {
  if (read_only) return Error{"/dev/shm is mounted read-only: mount -o remount,rw /dev/shm"};
  if (!writable) {
    return Error{
        fmt::format("this user may not write to /dev/shm (mode {:o}): as root, chmod 1777 /dev/shm", mode & 07777)};
  }
  return done;
}

Status check_writable() {
  struct stat info {};
  if (::stat("/dev/shm", &info) != 0) return done;  // check_shared_memory() says so
  const bool writable = ::faccessat(AT_FDCWD, "/dev/shm", W_OK | X_OK, AT_EACCESS) == 0;
  return check_writable(writable, !writable && errno == EROFS, info.st_mode);
}

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
