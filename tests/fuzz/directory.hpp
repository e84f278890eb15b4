#pragma once
#include <stdlib.h>

#include <filesystem>
#include <string>

namespace ledgerline::fuzz {

/// A folder that is gone at the end; in memory where there is some, since files are made ten thousand times.
class Directory {
 public:
  Directory() {
    std::string name =
        std::string(std::filesystem::exists("/dev/shm") ? "/dev/shm" : "/tmp") + "/ledgerline-fuzz-XXXXXX";
    path = ::mkdtemp(name.data());
  }
  ~Directory() { std::filesystem::remove_all(path); }
  Directory(const Directory&) = delete;
  Directory& operator=(const Directory&) = delete;
  std::string path;
};

}  // namespace ledgerline::fuzz
