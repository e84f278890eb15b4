#include "common/process/children.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <deque>
#include <fstream>
#include <sstream>
#include <string_view>

#include "common/base/text.hpp"
#include "common/process/usage.hpp"

namespace ledgerline {
namespace {

constexpr std::size_t max_line = 1 << 20;

// Between fork and exec: only what may be called there.
[[noreturn]] void become(char* const* command, char* const* environment, int output, int log, int death_signal,
                         Scheduling scheduling, pid_t parent) {
  prctl(PR_SET_PDEATHSIG, death_signal);
  if (getppid() != parent) _exit(127);
  setpgid(0, 0);
  // The launcher's handlers are for the launcher. What it ignores stays ignored.
  struct sigaction usual {};
  usual.sa_handler = SIG_DFL;
  for (int signal = 1; signal < NSIG; ++signal) {
    struct sigaction has {};
    if (sigaction(signal, nullptr, &has) == 0 && has.sa_handler != SIG_IGN) sigaction(signal, &usual, nullptr);
  }
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  const int nothing = ::open("/dev/null", O_RDONLY);
  if (nothing < 0 || dup2(nothing, 0) < 0 || dup2(output, 1) < 0 || dup2(log, 2) < 0) _exit(127);
  if (!enter_scheduling(scheduling)) {
    constexpr std::string_view refused = "its scheduling is refused: ";
    const char* why = std::strerror(errno);
    (void)!::write(2, refused.data(), refused.size());
    (void)!::write(2, why, std::strlen(why));
    _exit(127);
  }
  execve(command[0], command, environment);
  const char* why = std::strerror(errno);
  (void)!::write(2, why, std::strlen(why));
  _exit(127);
}

}  // namespace

Children::~Children() {
  for (Child& child : children_) {
    if (!child.ended) {
      ::kill(child.pid, SIGKILL);
      ::waitpid(child.pid, &child.status, 0);
    }
    if (child.output >= 0) ::close(child.output);
  }
}

Children::Child* Children::find(const std::string& name) {
  const auto found =
      std::find_if(children_.begin(), children_.end(), [&](const Child& c) { return c.program.name == name; });
  return found == children_.end() ? nullptr : &*found;
}

const Children::Child* Children::find(const std::string& name) const { return const_cast<Children*>(this)->find(name); }

Status Children::start(const Program& program) {
  const std::string& file = program.command.front();
  if (::access(file.c_str(), X_OK) != 0) {
    return Error{fmt::format("{} cannot be run: {}. Build it: ./fly does, or ninja -C build/release programs", file,
                             std::strerror(errno))};
  }
  const int log = ::open(program.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (log < 0) return Error{fmt::format("cannot write {}: {}", program.log, std::strerror(errno))};
  int pipe[2];
  if (::pipe2(pipe, O_CLOEXEC) != 0) {
    ::close(log);
    return Error{fmt::format("no pipe for {}: {}", program.name, std::strerror(errno))};
  }
  std::vector<char*> command;
  for (const std::string& word : program.command) command.push_back(const_cast<char*>(word.c_str()));
  command.push_back(nullptr);
  std::vector<char*> environment;
  for (const std::string& variable : program.environment) environment.push_back(const_cast<char*>(variable.c_str()));
  for (char** own = environ; *own != nullptr; ++own) environment.push_back(*own);
  environment.push_back(nullptr);
  const pid_t parent = ::getpid();
  // A signal to the child before it is the program would be swallowed by the launcher's handler: it waits until then.
  sigset_t all, before;
  sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  const pid_t pid = ::fork();
  if (pid == 0) {
    become(command.data(), environment.data(), pipe[1], log, program.death_signal, program.scheduling, parent);
  }
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
  ::close(pipe[1]);
  ::close(log);
  if (pid < 0) {
    ::close(pipe[0]);
    return Error{fmt::format("cannot start {}: {}", program.name, std::strerror(errno))};
  }
  ::fcntl(pipe[0], F_SETFL, O_NONBLOCK);
  Child child;
  child.program = program;
  child.pid = pid;
  child.output = pipe[0];
  if (Child* old = find(program.name)) {
    child.cpu_before_s = old->cpu_before_s;
    if (old->output >= 0) ::close(old->output);
    *old = std::move(child);  // a program that ran and ended, started again
  } else {
    children_.push_back(std::move(child));
    names_.push_back(program.name);
  }
  return done;
}

void Children::read_output(Child& child) {
  char buffer[16384];
  for (;;) {
    const ssize_t n = ::read(child.output, buffer, sizeof buffer);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0 && errno == EAGAIN) return;
    if (n <= 0) {
      ::close(child.output);
      child.output = -1;
      return;
    }
    child.partial.append(buffer, static_cast<std::size_t>(n));
    std::size_t start = 0;
    for (std::size_t end; (end = child.partial.find('\n', start)) != std::string::npos; start = end + 1) {
      if (on_line_) on_line_(child.program.name, child.partial.substr(start, end - start));
    }
    child.partial.erase(0, start);
    if (child.partial.size() > max_line) child.partial.clear();
  }
}

void Children::reap(Child& child) {
  rusage used{};
  if (child.ended || ::wait4(child.pid, &child.status, WNOHANG, &used) != child.pid) return;
  child.ended = true;
  for (const timeval& time : {used.ru_utime, used.ru_stime}) {
    child.cpu_before_s += static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_usec) * 1e-6;
  }
  if (child.output >= 0) read_output(child);
}

void Children::poll(TimeNs timeout_ns) {
  std::vector<pollfd> waiting;
  std::vector<Child*> whose;
  for (Child& child : children_) {
    if (child.output < 0) continue;
    waiting.push_back({child.output, POLLIN, 0});
    whose.push_back(&child);
  }
  // A signal to the launcher ends the wait early: the caller looks at it.
  ::poll(waiting.data(), waiting.size(), static_cast<int>(timeout_ns / ns_per_ms));
  for (std::size_t i = 0; i < waiting.size(); ++i) {
    if (waiting[i].revents != 0) read_output(*whose[i]);
  }
  for (Child& child : children_) reap(child);
}

bool Children::is_running(const std::string& name) const {
  const Child* child = find(name);
  return child && !child->ended;
}

pid_t Children::pid(const std::string& name) const { return is_running(name) ? find(name)->pid : 0; }

bool Children::has_succeeded(const std::string& name) const {
  const Child* child = find(name);
  return child && child->ended && WIFEXITED(child->status) && WEXITSTATUS(child->status) == 0;
}

bool Children::was_killed(const std::string& name) const {
  const Child* child = find(name);
  return child && child->ended && WIFSIGNALED(child->status);
}

std::string Children::how_it_ended(const std::string& name) const {
  const Child* child = find(name);
  if (!child || !child->ended) return "";
  if (WIFSIGNALED(child->status)) {
    const int signal = WTERMSIG(child->status);
    return fmt::format("was ended by signal {} ({})", signal, strsignal(signal));
  }
  return fmt::format("ended with exit code {}", WEXITSTATUS(child->status));
}

void Children::signal(const std::string& name, int signal) {
  Child* child = find(name);
  if (child && !child->ended) ::kill(child->pid, signal);
}

void Children::signal_group(const std::string& name, int signal) {
  const Child* child = find(name);
  if (child && child->pid > 0) ::kill(-child->pid, signal);
}

bool Children::stop(const std::string& name, TimeNs timeout_ns) {
  if (!is_running(name)) return true;
  signal(name, SIGTERM);
  const TimeNs until_ns = monotonic_ns() + timeout_ns;
  while (is_running(name) && monotonic_ns() < until_ns) poll(10 * ns_per_ms);
  if (!is_running(name)) return true;
  signal(name, SIGKILL);
  while (is_running(name)) poll(10 * ns_per_ms);
  return false;
}

double Children::cpu_seconds(const std::string& name) const {
  const Child* child = find(name);
  return !child || child->ended ? 0 : child->cpu_before_s + cpu_seconds_of(child->pid);
}

double Children::memory_mb(const std::string& name) const {
  const Child* child = find(name);
  return !child || child->ended ? 0 : memory_mb_of(child->pid);
}

std::string Children::log_tail(const std::string& name, int lines) const {
  const Child* child = find(name);
  if (!child) return "";
  std::ifstream file(child->program.log);
  std::deque<std::string> last;
  for (std::string line; std::getline(file, line);) {
    last.push_back(line);
    if (last.size() > static_cast<std::size_t>(lines)) last.pop_front();
  }
  std::string text;
  for (const auto& line : last) text += "  " + line + "\n";
  return text;
}

std::string find_program(std::string_view name, std::string_view also_in) {
  const std::string path = environment_variable("PATH");
  for (const std::string_view among : {std::string_view(path), also_in}) {
    std::istringstream folders{std::string(among)};
    for (std::string folder; std::getline(folders, folder, ':');) {
      const std::string file = fmt::format("{}/{}", folder.empty() ? "." : folder, name);
      if (::access(file.c_str(), X_OK) == 0) return file;
    }
  }
  return {};
}

std::optional<TimeNs> Restarts::ended(TimeNs now) {
  while (!recent_.empty() && now - recent_.front() > limits_.within) recent_.pop_front();
  if (recent_.size() >= static_cast<std::size_t>(limits_.max_restarts)) return std::nullopt;
  TimeNs wait = limits_.first_wait;
  for (std::size_t i = 0; i < recent_.size() && wait < limits_.max_wait; ++i) wait *= 2;
  wait = std::min(wait, limits_.max_wait);
  recent_.push_back(now);
  ++count_;
  return now + static_cast<TimeNs>(static_cast<double>(wait) * (0.5 + random_.uniform() / 2));
}

}  // namespace ledgerline
