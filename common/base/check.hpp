#pragma once
#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <string_view>

namespace ledgerline {

/// What the program itself must keep does not hold: "access.cpp:312: a record keeps its owner
/// (after.has_owner()), drone = tello1". Thrown by LEDGERLINE_CHECK. Who answers calls makes an error of it; elsewhere
/// it ends the program with these words.
class CheckFailed : public std::logic_error {
  using std::logic_error::logic_error;
};

/// The checks of a core that has to go on after one has failed, since it must land its drones. One thread.
class CheckLog {
 public:
  bool failed() const noexcept { return failures_ > 0; }
  unsigned failures() const noexcept { return failures_; }
  const std::string& first() const noexcept { return first_; }
  void add(std::string text) noexcept {
    if (failures_++ == 0) first_ = std::move(text);
  }

 private:
  unsigned failures_ = 0;
  std::string first_;
};

/// While it stands, checks that fail on this thread are written to `log` and not thrown.
class CheckScope {
 public:
  explicit CheckScope(CheckLog& log) noexcept;
  ~CheckScope();
  CheckScope(const CheckScope&) = delete;
  CheckScope& operator=(const CheckScope&) = delete;

 private:
  CheckLog* outer_;
};

/// Reports a failed check: false under a CheckScope, else CheckFailed. `names`, `values`: of what explains it.
bool check_failed(std::string_view file, int line, std::string_view condition, std::string_view meaning,
                  std::string_view names, const std::string& values);

template <typename... Values>
std::string check_values(const Values&... values) {
  std::string text;
  ((text += fmt::format("{}{}", text.empty() ? "" : ", ", values)), ...);
  return text;
}

template <typename Report>
bool check(bool holds, const Report& report) {
  return holds || report();
}

/// LEDGERLINE_CHECK(plan.until_ns > plan.from_ns, "a plan covers some time", plan.from_ns, plan.until_ns): what must
/// hold where it is relied on, in release builds, too. Its value says whether it holds, for code under a CheckScope
/// that cannot go on without. The values are of any type that fmt prints, and are read only when it fails.
#define LEDGERLINE_CHECK(condition, meaning, ...)                                                 \
  ::ledgerline::check(static_cast<bool>(condition), [&] {                                         \
    return ::ledgerline::check_failed(__FILE_NAME__, __LINE__, #condition, meaning, #__VA_ARGS__, \
                                      ::ledgerline::check_values(__VA_ARGS__));                   \
  })

}  // namespace ledgerline
