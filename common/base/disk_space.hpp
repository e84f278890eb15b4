#pragma once
#include <cstdint>
#include <string>

#include "common/base/result.hpp"

/// Room on file systems.
namespace ledgerline {

/// Bytes that the files below `directory` occupy, in whole blocks of their file system. Files that vanish meanwhile and
/// a missing directory count as zero.
std::uint64_t bytes_below(const std::string& directory);

/// Of the file system where `path` is, or would be made.
struct Room {
  std::uint64_t free_bytes = 0;  ///< to this user
  std::uint64_t all_bytes = 0;
};
Result<Room> room_at(const std::string& path);
Result<std::uint64_t> free_bytes(const std::string& path);

/// An error that names the place and both figures when fewer bytes are free than needed.
Status enough_space(const std::string& path, std::uint64_t free, std::uint64_t needed, const std::string& for_what);
/// The same, looking at the place.
Status check_space(const std::string& path, std::uint64_t needed, const std::string& for_what);

}  // namespace ledgerline
