#include "common/base/check.hpp"

namespace ledgerline {
namespace {

thread_local CheckLog* log_of_thread = nullptr;

}  // namespace

CheckScope::CheckScope(CheckLog& log) noexcept : outer_(log_of_thread) { log_of_thread = &log; }
CheckScope::~CheckScope() { log_of_thread = outer_; }

bool check_failed(std::string_view file, int line, std::string_view condition, std::string_view meaning,
                  std::string_view names, const std::string& values) {
  std::string text = fmt::format("{}:{}: {} ({})", file, line, meaning, condition);
  if (!names.empty()) text += fmt::format(", {} = {}", names, values);
  if (log_of_thread == nullptr) throw CheckFailed(text);
  log_of_thread->add(std::move(text));
  return false;
}

}  // namespace ledgerline
