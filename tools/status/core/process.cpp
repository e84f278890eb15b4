#include "tools/status/core/status.hpp"

#include <sstream>

namespace ledgerline::status {

std::vector<std::string> words_of(const std::string& cmdline) {
  std::vector<std::string> words;
  std::istringstream text(cmdline);
  for (std::string word; std::getline(text, word, '\0');) words.push_back(word);
  return words;
}

std::string config_of(const std::vector<std::string>& words) {
  const std::string option = "--config";
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (words[i] == option && i + 1 < words.size()) return words[i + 1];
    if (words[i].starts_with(option + "=")) return words[i].substr(option.size() + 1);
  }
  return {};
}

std::string unit_of(const std::string& cgroup) {
  std::istringstream lines(cgroup);
  for (std::string line; std::getline(lines, line);) {
    const std::string last = line.substr(line.rfind('/') + 1);
    if (last.ends_with(".service")) return last;
  }
  return {};
}

std::optional<double> start_of(const std::string& stat, double ticks_per_s) {
  constexpr int start = 22, behind_name = 3;
  const auto name_end = stat.rfind(')');  // a name may have blanks and brackets
  if (name_end == std::string::npos) return std::nullopt;
  std::istringstream fields(stat.substr(name_end + 1));
  std::string field;
  for (int number = behind_name; number <= start; ++number) {
    if (!(fields >> field)) return std::nullopt;
  }
  if (field.find_first_not_of("0123456789") != std::string::npos || field.size() > 18) return std::nullopt;
  return std::stod(field) / ticks_per_s;
}

Executable executable_of(const std::string& link) {
  const std::string gone = " (deleted)";
  if (link.ends_with(gone)) return {link.substr(0, link.size() - gone.size()), true};
  return {link, false};
}

}  // namespace ledgerline::status
