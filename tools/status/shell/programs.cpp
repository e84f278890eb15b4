#include "tools/status/shell/programs.hpp"

#include <fmt/format.h>
#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <tuple>

#include "common/base/file.hpp"

namespace ledgerline::status {
namespace {

namespace fs = std::filesystem;

std::string user_of(const std::string& folder) {
  struct stat status {};
  if (::stat(folder.c_str(), &status) != 0) return {};
  const passwd* const user = ::getpwuid(status.st_uid);
  return user ? user->pw_name : std::to_string(status.st_uid);
}

/// Empty: it is gone, or may not be read.
std::string text_of(const std::string& file) {
  auto text = read_file(file);
  return text ? std::move(*text) : std::string();
}

/// None: it is not ours, has ended meanwhile, or may not be looked at.
std::optional<Program> look_at(int pid, double up_s) {
  const std::string folder = fmt::format("/proc/{}", pid);
  std::error_code error;
  const fs::path link = fs::read_symlink(folder + "/exe", error);
  if (error) return std::nullopt;
  const Executable executable = executable_of(link);
  Program program{.name = fs::path(executable.file).filename(), .pid = pid, .replaced = executable.deleted};
  if (!program.name.starts_with("ledgerline-") || program.name == "ledgerline-status") return std::nullopt;
  const auto start_s = start_of(text_of(folder + "/stat"), static_cast<double>(::sysconf(_SC_CLK_TCK)));
  if (!start_s) return std::nullopt;
  program.age_ns = from_seconds(up_s - *start_s);
  program.user = user_of(folder);
  program.unit = unit_of(text_of(folder + "/cgroup"));
  program.config = config_of(words_of(text_of(folder + "/cmdline")));
  if (program.config.empty() || program.config.front() == '/') return program;
  const fs::path from = fs::read_symlink(folder + "/cwd", error);
  if (!error) program.config = (from / program.config).lexically_normal();
  return program;
}

}  // namespace

std::vector<Program> running_programs() {
  std::vector<Program> programs;
  const double up_s = std::strtod(text_of("/proc/uptime").c_str(), nullptr);
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    if (auto program = look_at(std::atoi(name.c_str()), up_s)) programs.push_back(std::move(*program));
  }
  std::ranges::sort(programs, {}, [](const Program& one) { return std::tie(one.name, one.pid); });
  return programs;
}

}  // namespace ledgerline::status
