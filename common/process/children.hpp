#pragma once
#include <sys/types.h>

#include <functional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/process/scheduling.hpp"
#include "common/rt/clock.hpp"

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
  struct Handlers {
    std::function<void(const std::string& name, const std::string& line)> on_line;
  };

  explicit Children(Handlers handlers) : handlers_(std::move(handlers)) {}
  ~Children();  ///< kills what still runs
  Children(const Children&) = delete;
  Children& operator=(const Children&) = delete;

  Status start(const Program& program);
  /// Waits up to `timeout_ns` for output or the end of a child, and reads both.
  void poll(TimeNs timeout_ns);
  bool running(const std::string& name) const;
  /// 0 when it does not run.
  pid_t pid(const std::string& name) const;
  /// "ended with exit code 1", "was ended by signal 11 (Segmentation fault)"; empty while it runs or if it never did.
  std::string how_it_ended(const std::string& name) const;
  bool ended_well(const std::string& name) const;
  void signal(const std::string& name, int signal);
  /// To all that this child started and that stayed in its process group, also after it has ended by itself.
  void signal_group(const std::string& name, int signal);
  /// SIGTERM, then SIGKILL after `timeout_ns`. False when it took the SIGKILL.
  bool stop(const std::string& name, TimeNs timeout_ns);
  /// User and system time so far, including that of the processes it started that still run, and of programs that ran
  /// under its name before; 0 when it does not run.
  double cpu_seconds(const std::string& name) const;
  /// Proportional set size (shared pages count in parts), including that of the processes it started that still run; 0
  /// when it does not run. To be called seldom: the kernel walks all page tables for it.
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

  Handlers handlers_;
  std::vector<Child> children_;
  std::vector<std::string> names_;
};

}  // namespace ledgerline
