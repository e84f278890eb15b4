#include "common/base/disk_space.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/statvfs.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace ledgerline {
namespace fs = std::filesystem;

std::uint64_t bytes_below(const std::string& directory) {
  constexpr std::uint64_t stat_block = 512;  // whatever the file system's own
  std::uint64_t sum = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(directory, error), end; !error && entry != end; entry.increment(error)) {
    struct stat info {};
    if (::lstat(entry->path().c_str(), &info) == 0) sum += static_cast<std::uint64_t>(info.st_blocks) * stat_block;
  }
  return sum;
}

Result<Room> room_at(const std::string& path) {
  std::error_code error;
  fs::path place = fs::absolute(path, error);
  while (!fs::exists(place, error) && place.has_relative_path()) place = place.parent_path();
  struct statvfs info {};
  if (::statvfs(place.c_str(), &info) != 0) {
    return Error{fmt::format("looking at the room in {}: {}", place.string(), std::strerror(errno))};
  }
  return Room{std::uint64_t{info.f_bavail} * info.f_frsize, std::uint64_t{info.f_blocks} * info.f_frsize};
}

Result<std::uint64_t> free_bytes(const std::string& path) {
  const auto room = room_at(path);
  return room ? Result(room->free_bytes) : room.error();
}

Status enough_space(const std::string& path, std::uint64_t free, std::uint64_t needed, const std::string& for_what) {
  if (free >= needed) return done;
  constexpr double mb = 1e6;
  return Error{fmt::format("{} has {:.0f} MB free, and {} needs {:.0f} MB: make room, or choose another place", path,
                           static_cast<double>(free) / mb, for_what, static_cast<double>(needed) / mb)};
}

Status check_space(const std::string& path, std::uint64_t needed, const std::string& for_what) {
  const auto free = free_bytes(path);
  if (!free) return free.error();
  return enough_space(path, *free, needed, for_what);
}

}  // namespace ledgerline
