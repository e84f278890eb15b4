#pragma once
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

namespace ledgerline {

/// A program under test: started, awaited until it says that it is ready, ended; never outlives the test.
class Child {
 public:
  Child() = default;
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (pid_ > 0) end(SIGKILL);
  }

  /// True once the ready line came; the program's later lines are not read, so it must not write many.
  bool start(const std::vector<std::string>& command) {
    int out[2];
    if (::pipe(out) != 0) return false;
    pid_ = ::fork();
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::dup2(out[1], STDOUT_FILENO);
      ::close(out[0]);
      ::close(out[1]);
      std::vector<char*> arguments;
      for (const std::string& argument : command) arguments.push_back(const_cast<char*>(argument.c_str()));
      arguments.push_back(nullptr);
      ::execv(arguments[0], arguments.data());
      ::_exit(127);
    }
    ::close(out[1]);
    lines_ = ::fdopen(out[0], "r");
    char line[512] = {};
    ready_line_ = std::fgets(line, sizeof line, lines_) != nullptr ? line : "";
    return ready_line_.find("\"ready\":true") != std::string::npos;
  }
  const std::string& ready_line() const { return ready_line_; }
  pid_t pid() const { return pid_; }
  double resident_mb() const {
    std::ifstream statm("/proc/" + std::to_string(pid_) + "/statm");
    double size = 0, resident = 0;
    statm >> size >> resident;
    return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1e6;
  }
  void signal(int signal) const { ::kill(pid_, signal); }
  /// Its exit status, as waitpid gives it.
  int wait() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = 0;
    if (lines_) std::fclose(lines_);
    lines_ = nullptr;
    return status;
  }
  int end(int with) {
    signal(with);
    return wait();
  }

 private:
  pid_t pid_ = 0;
  FILE* lines_ = nullptr;
  std::string ready_line_;
};

}  // namespace ledgerline
