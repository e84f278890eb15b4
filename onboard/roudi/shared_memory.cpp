#include "onboard/roudi/shared_memory.hpp"

#include <fmt/format.h>
#include <sys/statvfs.h>

namespace ledgerline::roudi {
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
