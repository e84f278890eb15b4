#include "common/base/files/changed_files.hpp"

#include <sys/stat.h>

namespace ledgerline {

bool ChangedFiles::look(const std::vector<std::string>& files) {
  auto now = stamps(files);
  const bool still = now == seen_;
  seen_ = std::move(now);
  if (!still || seen_ == taken_) return false;
  taken_ = seen_;
  return true;
}

std::vector<ChangedFiles::Stamp> ChangedFiles::stamps(const std::vector<std::string>& files) {
  std::vector<Stamp> all;
  for (const std::string& file : files) {
    struct stat info {};
    Stamp one{.file = file};
    if (!file.empty() && ::stat(file.c_str(), &info) == 0) {
      one.device = info.st_dev;
      one.inode = info.st_ino;
      one.size = static_cast<std::uint64_t>(info.st_size);
      one.changed_ns = info.st_ctim.tv_sec * std::int64_t{1'000'000'000} + info.st_ctim.tv_nsec;
    }
    all.push_back(std::move(one));
  }
  return all;
}

}  // namespace ledgerline
