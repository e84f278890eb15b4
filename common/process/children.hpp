#pragma once
#include <sys/types.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "common/rt/scheduling.hpp"

namespace ledgerline {

/// The programs of a launcher. Each one is a process of its own group (a Ctrl-C at the terminal reaches the launcher
/// alone), has its standard output read line by line, its standard error in a file, and ends when the launcher dies,
/// however it dies. Owned by the main thread, which must outlive all others: Linux ends children with the
/// thread that made them.
class Children {
 public:
  struct Program {
    std::string name;  ///< "node"
    std::vector<std::string> command;
    std::string log;                            ///< file for standard error
    int death_signal;                           ///< what it gets when the launcher dies
    std::vector<std::string> environment = {};  ///< "NAME=value", beside the launcher's own
    Scheduling scheduling = Scheduling::inherited;
  };
  using OnLine = std::function<void(const std::string& name, const std::string& line)>;

  explicit Children(OnLine on_line) : on_line_(std::move(on_line)) {}
  ~Children();  ///< kills what still runs
  Children(const Children&) = delete;
  Children& operator=(const Children&) = delete;

  Status start(const Program& program);
  /// Waits up to `timeout_ns` for output or the end of a child, and reads both.
  void poll(TimeNs timeout_ns);
  bool is_running(const std::string& name) const;
  /// 0 when it does not run.
  pid_t pid(const std::string& name) const;
  /// "ended with exit code 1", "was ended by signal 11 (Segmentation fault)"; empty while it runs or if it never did.
  std::string how_it_ended(const std::string& name) const;
  bool has_succeeded(const std::string& name) const;
  bool was_killed(const std::string& name) const;  ///< a signal ended it
  void signal(const std::string& name, int signal);
  /// To all that this child started and that stayed in its process group, also after it has ended by itself.
  void signal_group(const std::string& name, int signal);
  /// SIGTERM, then SIGKILL after `timeout_ns`. False when it took the SIGKILL.
  bool stop(const std::string& name, TimeNs timeout_ns);
  /// cpu_seconds_of() it and those that ran under its name before; 0 when it does not run.
  double cpu_seconds(const std::string& name) const;
  /// memory_mb_of() it; 0 when it does not run. To be called seldom.
  double memory_mb(const std::string& name) const;
  const std::vector<std::string>& names() const { return names_; }
  /// The last lines that it logged.
  std::string log_tail(const std::string& name, int lines) const;

 private:
  struct Child {
    Program program;
    pid_t pid = -1;
    int output = -1;
    bool ended = false;
    int status = 0;
    double cpu_before_s = 0;  ///< of those that had its name before, and its own when it has ended
    std::string partial;
  };
  Child* find(const std::string& name);
  const Child* find(const std::string& name) const;
  void read_output(Child& child);
  void reap(Child& child);

  OnLine on_line_;
  std::vector<Child> children_;
  std::vector<std::string> names_;
};

/// Where in PATH, and then in `also_in` (folders with colons between them), a program of this name is that may be run,
/// as a shell looks for it; empty: nowhere. Any thread that does not change the environment.
std::string find_program(std::string_view name, std::string_view also_in = {});

/// When a process that ended is started again: after a wait that doubles with each end within `within`, with jitter
/// (half to whole of it), so that processes that died together do not start together. After more than
/// `max_restarts` ends within `within` it is given up.
///
///     runs -- ended() --> waits -- the time it gave --> runs
///                 \-- nullopt: given up
class Restarts {
 public:
  struct Limits {
    int max_restarts = 10;  ///< within `within`
    TimeNs within = 60 * ns_per_s;
    TimeNs first_wait = 100 * ns_per_ms, max_wait = 5 * ns_per_s;
  };
  Restarts(Limits limits, std::uint64_t seed) : limits_(limits), random_(seed) {}

  /// It ended: when to start it again.
  std::optional<TimeNs> ended(TimeNs now);
  /// How often it has been given a new start.
  std::uint64_t count() const { return count_; }
  const Limits& limits() const { return limits_; }

 private:
  const Limits limits_;
  Random random_;
  std::deque<TimeNs> recent_;  ///< at most limits_.max_restarts
  std::uint64_t count_ = 0;
};

}  // namespace ledgerline
