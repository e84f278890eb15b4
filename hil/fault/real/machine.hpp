#pragma once
#include <sys/types.h>

#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "common/base/result.hpp"

// What faults do to the machine that a flight of the real processes runs on.
namespace ledgerline::hil {

/// Processes whose program has this name, among the descendants of `parent`.
std::vector<pid_t> descendants(pid_t parent, const std::string& program);

std::uint64_t available_memory();

/// Makes a file that leaves no byte of the disk.
Status fill(const std::string& path);

/// Computes on one core until it goes.
class CpuLoad {
 public:
  explicit CpuLoad(int core);
  bool pinned() const { return pinned_; }

 private:
  std::jthread thread_;
  bool pinned_ = false;
};

/// A small disk of this process and those that it starts, until this object's end.
class SmallDisk {
 public:
  SmallDisk() = default;
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  ~SmallDisk();
  Status mount(const std::string& directory);

 private:
  std::string directory_;
};

}  // namespace ledgerline::hil
