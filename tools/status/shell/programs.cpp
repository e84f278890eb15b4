#include "tools/status/shell/query.hpp"

#include <fmt/format.h>
#include <pwd.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <tuple>

#include "common/base/file.hpp"

namespace ledgerline::status {
namespace {

namespace fs = std::filesystem;

// Not the folder's owner: that is root where the program has keys (keep_memory_private()).
std::string user_of(const std::string& status) {
  constexpr std::string_view field = "\nUid:";
  const auto at = status.find(field);
  if (at == std::string::npos) return {};
  const auto id = static_cast<uid_t>(std::strtoul(status.c_str() + at + field.size(), nullptr, 10));
  const passwd* const user = ::getpwuid(id);
  return user ? user->pw_name : std::to_string(id);
}

/// Empty: it is gone, or may not be read.
std::string text_of(const std::string& file) {
  auto text = read_file(file);
  return text ? std::move(*text) : std::string();
}

/// None: it is not ours, has ended meanwhile, or may not be looked at.
std::optional<Program> read_program(int pid, double up_s) {
  const std::string folder = fmt::format("/proc/{}", pid);
  std::error_code error;
  fs::path link = fs::read_symlink(folder + "/exe", error);
  const std::vector<std::string> words = words_of(text_of(folder + "/cmdline"));
  // Of a program with keys the link is root's (keep_memory_private()).
  if (error && !words.empty()) link = words.front();
  if (link.empty()) return std::nullopt;
  const Executable executable = executable_of(link);
  Program program{.name = name_of(executable.file, words), .pid = pid, .replaced = executable.deleted};
  if (program.name.empty() || program.name == "ledgerline status") return std::nullopt;
  const auto start_s = start_of(text_of(folder + "/stat"), static_cast<double>(::sysconf(_SC_CLK_TCK)));
  if (!start_s) return std::nullopt;
  program.age_ns = from_seconds(up_s - *start_s);
  const std::string described = text_of(folder + "/status");
  program.user = user_of(described);
  program.halted = is_halted(described);
  program.unit = unit_of(text_of(folder + "/cgroup"));
  program.config = value_of("--config", words);
  if (program.config.empty() && is_service(program.name.substr(program.name.find('-') + 1)) && words.size() == 2 &&
      !words[1].starts_with('-'))
    program.config = words[1];
  program.dir = value_of("--dir", words);
  const fs::path from = fs::read_symlink(folder + "/cwd", error);
  for (std::string* const file : {&program.config, &program.dir})
    if (!error && !file->empty()) *file = (from / *file).lexically_normal();
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
    if (auto program = read_program(std::atoi(name.c_str()), up_s)) programs.push_back(std::move(*program));
  }
  std::ranges::sort(programs, {}, [](const Program& one) { return std::tie(one.name, one.pid); });
  return programs;
}

std::vector<NotRunning> not_running(const checks::Configs& configs, const std::vector<Program>& programs) {
  std::vector<NotRunning> all;
  for (const checks::ProgramConfig& one : configs.programs) {
    const std::string path = fs::absolute(one.path).lexically_normal();
    if (is_service(one.program) && !is_running(programs, one.program, path)) all.push_back({one.program, path});
  }
  if (configs.node && std::ranges::find(programs, "ledgerline-node", &Program::name) == programs.end())
    all.push_back({"node", fs::absolute(configs.node->path).lexically_normal()});
  return all;
}

}  // namespace ledgerline::status
