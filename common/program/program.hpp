#pragma once
#include <atomic>
#include <csignal>
#include <cstdint>
#include <ctime>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>

#include "common/base/result.hpp"
#include "common/rt/trace.hpp"

namespace ledgerline {

class Config;

/// How every program ends: 0 as it should, 1 it could not do its work, 2 it was asked in a way that makes no sense.
inline constexpr int exit_failed = 1;
inline constexpr int exit_usage = 2;

/// What --version prints of a program, which is as it is typed ("ledgerline-agent"), without a line's end.
std::string version_line(const std::string& program);

/// Where bin/, libexec/ledgerline/ and share/ledgerline/ are, of which this program is in one of the first two:
/// build/PRESET, or a prefix of installation such as /usr.
std::filesystem::path build_or_prefix();
/// The folder of `ledgerline` and the daemons. LEDGERLINE_BIN, for tests, puts others in their place.
std::filesystem::path programs_directory();

/// Logs what went wrong and returns `exit_code`: `return fail(status.error());`
int fail(const Error& error, int exit_code = exit_failed);
/// The exit code of work that ended: what went wrong is logged; false is a failure that the program has reported
/// itself.
int exit_code(const Status& ended);
int exit_code(const Result<bool>& ended);

/// From here on, what std::filesystem or fmt throws and nobody catches (its working folder is gone, a disk fails) ends
/// the program with exit_failed, and with path and reason on standard error. CommandLine::parse() calls it.
void report_uncaught_file_errors();

/// From here on, a program that ends as it should, but whose standard output (a file on a full disk) did not take all
/// that was printed, ends with exit_failed and with a word on standard error; not after outlive_readers().
/// CommandLine::parse() calls it.
void report_lost_output();

/// Set and counted by the signals that catch_stop_signals() catches: the program shall end. Two within 200 ms are one
/// request: a wrapper (ros2 launch, npm, timeout) and the terminal pass on the same Ctrl-C. A person needs longer.
inline std::atomic<bool> stop_requested{false};
inline std::atomic<int> stop_requests{0};
inline std::atomic<std::int64_t> last_stop_request_ms{-1};
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free &&
              std::atomic<std::int64_t>::is_always_lock_free);

inline void on_stop_signal(int) {
  constexpr std::int64_t one_request_ms = 200;
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  const std::int64_t now_ms = std::int64_t{now.tv_sec} * 1000 + now.tv_nsec / 1'000'000;
  const std::int64_t last_ms = last_stop_request_ms.exchange(now_ms);
  if (last_ms < 0 || now_ms - last_ms >= one_request_ms) ++stop_requests;
  stop_requested = true;
}

/// Catches SIGINT and SIGTERM, or those named; calls that wait are interrupted. To be called before any thread starts.
inline void catch_stop_signals(std::initializer_list<int> signals = {SIGINT, SIGTERM}) {
  struct sigaction action {};
  action.sa_handler = on_stop_signal;
  for (const int signal : signals) ::sigaction(signal, &action, nullptr);
}

/// catch_stop_signals() for a program that runs until it is asked to end. When its terminal is closed it ends in its
/// own way, too, unless it was started to outlive that (nohup).
inline void catch_stop_signals_of_service() {
  catch_stop_signals();
  struct sigaction hangup {};
  ::sigaction(SIGHUP, nullptr, &hangup);
  if (hangup.sa_handler != SIG_IGN) catch_stop_signals({SIGHUP});
}

/// Blocks these signals in this thread and those that it starts, so that sigwait() alone sees them; returns them.
inline sigset_t block_signals(std::initializer_list<int> signals = {SIGINT, SIGTERM}) {
  sigset_t blocked;
  sigemptyset(&blocked);
  for (const int signal : signals) sigaddset(&blocked, signal);
  pthread_sigmask(SIG_BLOCK, &blocked, nullptr);
  return blocked;
}

/// catch_stop_signals() for a loop that waits in ppoll or pselect: signals are blocked but while it waits with the mask
/// that this returns, so none can be missed between its look at stop_requested and the wait.
inline sigset_t catch_stop_signals_while_waiting() {
  catch_stop_signals();
  sigset_t before;
  pthread_sigmask(SIG_BLOCK, nullptr, &before);
  block_signals();
  sigdelset(&before, SIGINT);
  sigdelset(&before, SIGTERM);
  return before;
}

/// For a program that runs until it is asked to end, before it starts threads. A reader of its output may go: writing
/// fails from then on, where a tool is to end with its reader. Its log may stand still: no thread of the program waits
/// for it. Else a `tee` would end a link in the air.
void outlive_readers();

/// A line of results, which are read as they come, or by nobody any more: that is no error.
void print_line(const std::string& line);
/// The same of a line that the next one replaces: left out while the reader stalls, so no loop waits for it. A line of
/// more than 4,096 bytes may wait all the same.
void print_status(const std::string& line);

/// A program whose only argument is a TOML file.
struct ConfigProgram {
  std::string name;   ///< as it is typed
  std::string about;  ///< above the options in help
  std::string notes;  ///< below them: examples, keys, exit codes
};

/// How a service takes its config: behind --config or alone.
inline constexpr const char* config_argument = "--config,CONFIG";

/// main() of such a program: command line, log, SIGINT, SIGTERM and SIGHUP, and the file; then `run`, which returns the
/// exit code. It outlives who reads its output (outlive_readers).
int run_with_config(int argc, char** argv, const ConfigProgram& program, const std::function<int(Config&)>& run);

/// The first line of a file that others may not read (is_private()), of at most 4 kB. An error names it and says the
/// cure.
Result<std::string> read_secret(const std::string& file);

/// Asks at the terminal, without showing what is typed; where standard input is none: its first line. `prompt`:
/// "Password".
Result<std::string> ask_secret(const std::string& prompt);

/// What a program writes down of its run, where it is asked to: a trace while it goes on, a summary when it ends. One
/// thread.
class Recorder {
 public:
  /// Opens the trace; no file where the name is empty.
  Status open(const std::string& trace_file);
  void add(std::span<const TraceRecord> records);
  /// The rest of the trace, with a warning if records did not fit; then what `summary` makes, into `summary_file`, if
  /// that is not empty.
  Status end(const std::string& summary_file, const std::function<std::string()>& summary);

 private:
  std::string trace_file_;
  std::optional<TraceWriter> trace_;
};

/// Help of the tables that several programs' configs have, each read by one reader (common/fabric/config.hpp,
/// common/dds/dds.hpp, common/bridge/core/rules.hpp): lines for a program's notes.
inline const std::string ledger_table_help =
    "  [ledger] endpoint, tls_ca, msp_id, msp_dir (or certificate, private_key), blocks, timeouts (fixed|auto);\n"
    "  [[orderer]], [[peer]] endpoint, tls_ca, and as [ledger] server_name, tls_certificate, tls_key; [[msp]] id, ca\n";

inline const std::string channel_tables_help =
    "  [[channel]] name, contract, config_block, endpoint, tls_ca, server_name, tls_certificate, tls_key: a further\n"
    "    channel; [[drone]] channel; [[orderer]], [[endorser]], [[peer]] channels (docs/fabric.md)\n";

inline const std::string dds_table_help =
    "  [dds] domain (ROS_DOMAIN_ID); local_only, interfaces and peers, or cyclonedds; ros_release; for DDS Security\n"
    "    identity_ca, certificate, private_key, governance, permissions\n";

inline const std::string topic_tables_help =
    "  [[topic]] name (\"/a/b\", * stands for any characters), and with defaults\n"
    "    type (any), direction (both|to_ledger|from_ledger), from (first segment of the ids that are taken from\n"
    "    the ledger, must be given; \"*\": anybody's), channel,\n"
    "    keep (all|latest), latched, stream, rate_hz, every, priority (0-9, 5), queue (256), reliable, depth\n"
    "  [[enrolled]] name: enrolled to this identity; topics below /NAME/ have the id NAME/... on the ledger,\n"
    "    all others MSPID/...\n"
    "  [bridge] name, min_gap_ms; [output] status: a file for `ledgerline topics`\n";

}  // namespace ledgerline
