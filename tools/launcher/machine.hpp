#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "tools/checks/core/problem.hpp"

namespace ledgerline::launcher {

/// One flight at a time on a machine: shared memory and the drones' ports are the machine's own. Children inherit the
/// lock, so it is held until the last process of a run is gone, even when the launcher was killed.
class RunLock {
 public:
  static constexpr const char* machine_file = "/tmp/ledgerline-fly.lock";

  /// The error names who holds it. `about`: the message for the next one.
  static Result<RunLock> acquire(const std::string& file, const std::string& about);
  RunLock(RunLock&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  RunLock& operator=(RunLock&&) = delete;
  ~RunLock();

 private:
  explicit RunLock(int fd) : fd_(fd) {}
  int fd_;
};

/// What stands in the way of a flight. Looks at shared memory (room, leftovers of a RouDi that died, another RouDi that
/// lives) and at the UDP ports of `drones` drones and of link. Leftovers of our own are removed: `notes` says so, and
/// what else is good to know.
checks::Findings check_machine(int drones, std::vector<std::string>& notes);

/// Removes what a RouDi that is gone left in /dev/shm and /tmp, unless another one lives.
void remove_roudi_leftovers();

/// For the results.
struct Machine {
  std::string cpu, system;
  unsigned cores = 0;
  double memory_gb = 0;
};
Machine describe_machine();

/// A TCP port of an address of this host that nobody has now, so that a ground that is started again serves where its
/// page looks for it; 0: there is none, or the address is not this host's.
int free_port(const std::string& address = "127.0.0.1");

/// "127.0.0.2" for drone 1.
std::string address_of(int drone);

/// Opens `url` in the local user's browser (xdg-open), which is a process of its own. The url holds a token, so the
/// browser is given `file`, made for this owner alone, which leads there: a command line can be read by everybody.
Status open_in_browser(const std::string& url, const std::string& file);

}  // namespace ledgerline::launcher
