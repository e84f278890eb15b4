#include "tools/init/core/host.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>

#include "common/base/file.hpp"

namespace ledgerline::init {

Status check_new(const std::vector<std::string>& paths) {
  std::vector<std::string> there;
  for (const std::string& path : paths) {
    std::error_code error;
    // A link that leads nowhere is there, too.
    if (std::filesystem::symlink_status(path, error).type() != std::filesystem::file_type::not_found)
      there.push_back(path);
  }
  if (there.empty()) return done;
  return Error{fmt::format("{} {} there already; nothing was written. Move what is no longer wanted away",
                           fmt::join(there, ", "), there.size() == 1 ? "is" : "are")};
}

Status write_new(const std::vector<NewFile>& files) {
  std::vector<std::string> others;
  std::vector<const NewFile*> missing;
  for (const NewFile& file : files) {
    const auto known = read_file(file.path);
    if (known && *known == file.content) continue;
    others.push_back(file.path);
    missing.push_back(&file);
  }
  if (auto status = check_new(others); !status) return status;
  for (const NewFile* file : missing)
    if (auto status = write_file(file->path, file->content, file->mode); !status) return status;
  return done;
}

}  // namespace ledgerline::init
