#pragma once
#include <map>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/process/children.hpp"

namespace ledgerline::network {

/// The processes of a network, and the commands that set it up. While it is being set up a process that ends is an
/// error; from supervise() on it is started again, as Restarts decides. One thread, which must outlive all
/// others (Children).
class Processes {
 public:
  /// `logs`: folder with a file for each.
  explicit Processes(std::string logs, Restarts::Limits limits = {});

  /// `address`: for people, where it listens. Started again it is scheduled as before.
  Status start(const std::string& name, const std::string& address, std::vector<std::string> command,
               std::vector<std::string> environment, Scheduling scheduling = Scheduling::inherited);
  void supervise() { supervising_ = true; }
  /// Looks after them for so long. An error, with the last lines of its log: one has ended, and is not started again.
  Status poll(TimeNs duration);
  /// Ends one that hangs; it starts again as any that ended.
  void kill(const std::string& name);
  /// Ends all, the last one started first. False: one of them had to be killed.
  bool stop();

  /// Runs a command to its end; what it printed. `what` is for errors.
  Result<std::string> run(const std::string& what, std::vector<std::string> command,
                          std::vector<std::string> environment);
  /// The same until it succeeds or says `good_too`, at most so long: the other side is just starting.
  Status run_until_good(const std::string& what, const std::vector<std::string>& command,
                        const std::vector<std::string>& environment, TimeNs limit, const std::string& good_too = {});

  struct State {
    std::string name, address;
    pid_t pid = 0;  ///< 0: waits for its next start
    std::uint64_t restarts = 0;
    double cpu_s = 0;  ///< user and system time so far
  };
  std::vector<State> states() const;
  bool has_printed(const std::string& name, const std::string& text) const;

 private:
  struct Service {
    std::string name, address;
    std::vector<std::string> command, environment;
    Scheduling scheduling;
    Restarts restarts;
    TimeNs start_at = 0;  ///< > 0: it has ended and waits
  };
  Status launch(const Service& service);
  Status restart_ended(Service& service);
  std::string log_of(const std::string& name) const { return logs_ + "/" + name + ".log"; }

  const std::string logs_;
  const Restarts::Limits limits_;
  bool supervising_ = false;
  std::vector<Service> services_;  // in the order of their start
  std::map<std::string, std::string> output_;
  int commands_ = 0;
  Children children_;
};

/// A program that is run to its end.
struct Command {
  std::string what;  ///< for errors: "enrolling peer0.org1.ledgerline"
  std::vector<std::string> words;
  std::vector<std::string> environment =
      {};  ///< "NAME=value"; the place for secrets: the words of a process are public
};

/// Runs the commands of each lane one after the other, the lanes side by side. What each lane printed last, by lane;
/// the first failure ends all, with the last lines of its lane's log (`log_stem`-N.log). Each command has a minute.
/// Must be called on the thread that outlives all others (Children).
Result<std::vector<std::string>> run_lanes(const std::vector<std::vector<Command>>& lanes, const std::string& log_stem);

/// One command: what it printed.
Result<std::string> run_command(const Command& command, const std::string& log);

}  // namespace ledgerline::network
