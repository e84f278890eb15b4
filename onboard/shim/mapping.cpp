#include "onboard/shim/mapping.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/futex.h>
#include <linux/magic.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/vfs.h>
#include <unistd.h>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <new>
#include <utility>

namespace ledgerline::drone_shim {

namespace {

static_assert(std::atomic<std::uint64_t>::is_always_lock_free && std::atomic<std::uint32_t>::is_always_lock_free,
              "locks of one process are none of another's");

Error failed(const std::string& path, std::string_view what) {
  return Error{fmt::format("{}: {}: {}", path, what, std::strerror(errno))};
}

// Byte 0 is the drones' end, byte 1 is link's.
struct flock lock_of(End end, short type) {
  struct flock lock {};
  lock.l_type = type;
  lock.l_whence = SEEK_SET;
  lock.l_start = end == End::drones ? 0 : 1;
  lock.l_len = 1;
  return lock;
}

bool set_lock(int fd, End end, short type) {
  struct flock lock = lock_of(end, type);
  return ::fcntl(fd, F_OFD_SETLK, &lock) == 0;
}

Status check_in_memory(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  struct statfs where {};
  if (::statfs(folder.empty() ? "." : folder.c_str(), &where) != 0) return failed(path, "cannot tell where it lies");
  if (where.f_type == TMPFS_MAGIC) return done;
  return Error{
      fmt::format("{}: must lie in memory, or link's loop would wait for a disk: choose a file in /dev/shm", path)};
}

// So that a name that was mistyped costs nobody a file.
bool is_empty_or_shim(int fd, off_t size) {
  std::uint64_t first = 0;
  if (size == 0) return true;
  if (::pread(fd, &first, sizeof first, 0) != sizeof first) return false;
  // One that was killed while it made the file leaves zeros.
  constexpr int number_bits = 16;
  return first == 0 ? size == static_cast<off_t>(sizeof(Memory))
                    : first >> number_bits == Memory::layout >> number_bits;
}

Error other_build(const std::string& path) {
  return Error{fmt::format("{}: it is no shim of this build of Ledgerline, or not ready yet", path)};
}

}  // namespace

Result<Mapping> Mapping::open(const std::string& path, End end, bool lockstep) {
  if (const Status in_memory = check_in_memory(path); !in_memory) return in_memory.error();
  // Who ends meanwhile removes the file: then there is another one, or none.
  constexpr int tries = 100;
  constexpr useconds_t between_us = 2'000;
  for (int i = 0; i < tries; ++i) {
    auto mapping = try_open(path, end, lockstep);
    if (!mapping) return mapping.error();
    if (*mapping) return std::move(**mapping);
    ::usleep(between_us);
  }
  return Error{fmt::format("{}: others create and remove it repeatedly", path)};
}

Result<std::optional<Mapping>> Mapping::try_open(const std::string& path, End end, bool lockstep) {
  const bool makes = end == End::drones;
  const int fd = ::open(path.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | (makes ? O_CREAT : 0), 0600);
  if (fd < 0) {
    if (errno == ENOENT && !makes)
      return Error{fmt::format("{}: there is no shim: start `ledgerline hil shim` first", path)};
    return failed(path, "cannot open it");
  }
  Mapping mapping("", end, fd);  // without a name: a file that is another's stays
  struct stat info {};
  if (::fstat(fd, &info) != 0) return failed(path, "cannot look at it");
  if (!S_ISREG(info.st_mode) || info.st_uid != ::geteuid() || (info.st_mode & 0077U) != 0)
    return Error{fmt::format("{}: must be a file of this user alone (mode 0600): choose another, or remove it", path)};
  if (!set_lock(fd, end, F_WRLCK))
    return Error{fmt::format("{}: another process holds this end of it: end that one first", path)};
  // Held while it is made, so that no link sees half of it.
  const bool recreates = makes && set_lock(fd, End::link, F_WRLCK);
  if (::fstat(fd, &info) != 0) return failed(path, "cannot look at it");
  const bool still_nothing = !recreates && info.st_size == 0;
  if (info.st_nlink == 0 || (makes && still_nothing)) return std::optional<Mapping>();
  if (recreates && !is_empty_or_shim(fd, info.st_size))
    return Error{fmt::format("{}: there is another file of this name: choose another, or remove it", path)};
  if (recreates && ::ftruncate(fd, 0) != 0) return failed(path, "cannot recreate it");
  // Room is taken now, or a full memory would end the process at its first write.
  if (const int why = recreates ? ::posix_fallocate(fd, 0, sizeof(Memory)) : 0; why != 0)
    return Error{fmt::format("{}: no room for it: {}", path, std::strerror(why))};
  if (!recreates && info.st_size != static_cast<off_t>(sizeof(Memory))) return other_build(path);
  void* place = ::mmap(nullptr, sizeof(Memory), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd, 0);
  if (place == MAP_FAILED) return failed(path, "cannot map it");
  mapping.memory_ = static_cast<Memory*>(place);
  if (recreates) {
    Memory* made = ::new (place) Memory;
    made->bytes = sizeof(Memory);
    made->lockstep = lockstep;
    made->ready.store(Memory::layout, std::memory_order_release);
    if (!set_lock(fd, End::link, F_UNLCK)) return failed(path, "cannot give link's end free");
  }
  const Memory& memory = *mapping.memory_;
  if (memory.ready.load(std::memory_order_acquire) != Memory::layout || memory.bytes != sizeof(Memory))
    return other_build(path);
  mapping.path_ = path;
  if (memory.lockstep != lockstep)
    return Error{
        fmt::format("{}: `ledgerline hil shim` moves the clock and link does not let it, or the other way "
                    "round: --lockstep and [shim] lockstep = true go together",
                    path)};
  mapping.forget_what_came();
  return std::optional<Mapping>(std::move(mapping));
}

void Mapping::forget_what_came() noexcept {
  const auto empty = [](auto& ring, auto element) {
    while (ring.pop(element)) {
    }
  };
  if (end_ == End::drones) {
    empty(memory_->to_drones, Datagram{});
    empty(memory_->states, StateSample{});
    empty(memory_->transitions, Transition{});
    return;
  }
  empty(memory_->to_link, Datagram{});
  empty(memory_->plans, Plan{});
  empty(memory_->poses, Pose{});
  empty(memory_->heartbeats, AgentHeartbeat{});
}

Mapping::Mapping(Mapping&& other) noexcept
    : path_(std::exchange(other.path_, {})),
      end_(other.end_),
      fd_(std::exchange(other.fd_, -1)),
      memory_(std::exchange(other.memory_, nullptr)) {}

Mapping::~Mapping() {
  if (memory_) {
    if (!path_.empty() && !other_lives()) (void)::unlink(path_.c_str());
    ::munmap(memory_, sizeof(Memory));
  }
  if (fd_ >= 0) ::close(fd_);
}

bool Mapping::other_lives() const noexcept {
  struct flock lock = lock_of(end_ == End::drones ? End::link : End::drones, F_WRLCK);
  return ::fcntl(fd_, F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

void wait_while(const std::atomic<std::uint32_t>& word, std::uint32_t old, TimeNs max_ns) noexcept {
  const timespec bound{max_ns / ns_per_s, max_ns % ns_per_s};
  // Woken, changed before, interrupted or over: the caller looks in every case.
  (void)!::syscall(SYS_futex, &word, FUTEX_WAIT, old, &bound, nullptr, 0);
}

void wake(std::atomic<std::uint32_t>& word) noexcept {
  (void)!::syscall(SYS_futex, &word, FUTEX_WAKE, 1, nullptr, nullptr, 0);
}

Result<DronesEnd> DronesEnd::open(const std::string& path, bool lockstep) {
  auto mapping = Mapping::open(path, End::drones, lockstep);
  if (!mapping) return mapping.error();
  return DronesEnd(std::move(*mapping));
}

bool DronesEnd::send(DroneNumber drone, Datagram::Port port, std::string_view text) noexcept {
  Datagram datagram;
  datagram.drone = drone;
  datagram.port = port;
  return datagram.assign(text) && mapping_.memory().to_link.push(datagram);
}

void DronesEnd::request_turn(TimeNs now) noexcept {
  Memory::Turns& turns = mapping_.memory().turns;
  turns.now_ns.store(now, std::memory_order_relaxed);
  turns.asked.fetch_add(1, std::memory_order_release);
  wake(turns.asked);
}

DronesEnd::Turn DronesEnd::wait_turn(TimeNs max_ns) noexcept {
  Memory::Turns& turns = mapping_.memory().turns;
  const std::uint32_t asked = turns.asked.load(std::memory_order_relaxed);
  const TimeNs until_ns = monotonic_ns() + max_ns;
  while (true) {
    const std::uint32_t done = turns.done.load(std::memory_order_acquire);
    if (done == asked) return Turn::made;
    const TimeNs left_ns = until_ns - monotonic_ns();
    if (left_ns <= 0) return is_link_alive() ? Turn::in_progress : Turn::no_link;
    wait_while(turns.done, done, left_ns);
  }
}

}  // namespace ledgerline::drone_shim
