#include "common/process/find_program.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <sstream>

namespace ledgerline {

std::string find_program(std::string_view name, std::string_view also_in) {
  const char* path = std::getenv("PATH");
  for (const std::string_view among : {std::string_view(path ? path : ""), also_in}) {
    std::istringstream folders{std::string(among)};
    for (std::string folder; std::getline(folders, folder, ':');) {
      const std::string file = fmt::format("{}/{}", folder.empty() ? "." : folder, name);
      if (::access(file.c_str(), X_OK) == 0) return file;
    }
  }
  return {};
}

}  // namespace ledgerline
