#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <csignal>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/launcher/configs.hpp"
#include "tools/launcher/launcher.hpp"
#include "tools/launcher/machine.hpp"
#include "tools/launcher/options.hpp"
#include "tools/report/results.hpp"

namespace {

using namespace ledgerline;
namespace fs = std::filesystem;

// In the tree's build folder: build/runs/TIME; elsewhere: ./runs/TIME.
Result<fs::path> default_run_directory() {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  char name[64];
  std::strftime(name, sizeof name, "%Y%m%d-%H%M%S", &local);
  const fs::path build = build_or_prefix().parent_path();
  if (build.filename() == "build") return build / "runs" / name;
  std::error_code error;
  const fs::path here = fs::current_path(error);
  if (error) return Error{"the working folder: " + error.message()};
  return here / "runs" / name;
}

int failed(const std::string& what) {
  fmt::print(stderr, "fly: {}\n", what);
  return EXIT_FAILURE;
}

/// The ledger's directory in memory: one flight at a time has it, and what a killed one left is removed.
class MemoryDirectory {
 public:
  static Result<std::unique_ptr<MemoryDirectory>> make(const launcher::RunFiles& files) {
    std::error_code error;
    fs::remove_all(path, error);
    // One that somebody else made meanwhile is not ours.
    if (!error && !fs::create_directory(path, error) && !error) error = std::make_error_code(std::errc::file_exists);
    if (!error) fs::permissions(path, fs::perms::owner_all, error);
    if (!error) fs::create_symlink(path, files.in("ledger"), error);
    if (error) return Error{fmt::format("cannot make {}: {}", path, error.message())};
    return std::unique_ptr<MemoryDirectory>(new MemoryDirectory(files.in("ledger")));
  }
  ~MemoryDirectory() {
    std::error_code error;
    fs::remove_all(path, error);
    if (error) fmt::print(stderr, "fly: cannot remove {}: {}\n", path, error.message());
    fs::remove(link_, error);
  }
  static constexpr const char* path = "/dev/shm/ledgerline-ledger";

 private:
  explicit MemoryDirectory(std::string link) : link_(std::move(link)) {}
  std::string link_;
};

int fly_and_report(const launcher::Options& options, const launcher::RunFiles& files) {
  fmt::print(stderr, "{} {} {}; everything of this run is in {}\n",
             options.drones == 1 ? "One drone" : fmt::format("{} drones", options.drones),
             options.manual              ? fmt::format("flown by hand, by {}ROS 2 topics (/{}/takeoff, cmd_vel, land)",
                                          options.watch ? "the page or " : "", drone_name(options, 1))
             : options.waypoints.empty() ? "around a " + ground::name_of(options.shape)
                                         : "along " + options.course_file,
             options.ledger == launcher::Ledger::none ? "without a ledger" : "through the ledger", files.directory);
  launcher::Launcher launcher(options, files, programs_directory(), ::isatty(STDERR_FILENO) == 1, stop_requests);
  const launcher::RunRecord record = launcher.run();
  report::Results results = report::read_results(files, options, record);
  Status written = done;
  if (!options.json.empty()) written = write_file(options.json, report::to_json(results).dump(2) + "\n");
  if (record.begin_ns > 0) {
    std::cout << report::to_table(results);
    const auto page = report::to_page(results, report::chart_js_file);
    const Status shown = page ? write_file(files.in("report.html"), *page) : Status(page.error());
    if (shown) std::cout << "  page: " << files.in("report.html") << "\n";
    if (!shown) fmt::print(stderr, "fly: no page: {}\n", shown.error().message);
    if (written) written = shown;
  }
  std::cout.flush();
  if (!results.ok) return failed(results.why);
  if (!written) return failed(written.error().message);
  return std::cout ? EXIT_SUCCESS
                   : failed("standard output took less than the whole report: no room, or nobody reads it");
}

}  // namespace

int ledgerline::command::fly(int argc, char** argv) {
  report_uncaught_file_errors();
  const launcher::ParsedOptions asked = launcher::parse_command_line({argv + 1, argv + argc});
  if (!asked.fly) {
    (asked.exit_code == 0 ? std::cout : std::cerr) << asked.text;
    return asked.exit_code;
  }
  const Result<fs::path> out = asked.options.out.empty() ? default_run_directory() : fs::path(asked.options.out);
  if (!out) return failed(out.error().message);
  launcher::RunFiles files{fs::absolute(*out)};
  if (const std::string problem = utf8_path_problem(files.directory); !problem.empty())
    return failed("--out: " + problem);
  const auto lock = launcher::RunLock::acquire(launcher::RunLock::machine_file,
                                               fmt::format("process {}, into {}", ::getpid(), files.directory));
  if (!lock) return failed(lock.error().message);

  std::vector<std::string> notes = asked.options.notes;
  const auto problems = launcher::check_machine(asked.options.own ? 0 : asked.options.drones, notes);
  if (!environment_variable("CYCLONEDDS_URI").empty() && asked.options.cyclonedds.empty())
    notes.emplace_back("CYCLONEDDS_URI is set and not looked at: DDS stays on this machine (or give --dds FILE)");
  for (const auto& note : notes) fmt::print(stderr, "note: {}\n", note);
  if (!problems.empty()) fmt::print(stderr, "{}", words(problems));
  if (!problems.empty()) return failed("this machine is not ready to fly");

  std::error_code error;
  const bool made = fs::create_directories(files.directory, error);
  if (made && !error) fs::permissions(files.directory, fs::perms::owner_all, error);  // configs, traces, keys
  if (error) return failed(fmt::format("cannot make {}: {}", files.directory, error.message()));
  if (fs::exists(files.in("ledger"), error) && !fs::is_empty(files.in("ledger"), error))
    return failed(fmt::format("{} holds another run already: choose another --out", files.directory));
  const std::string ledger = asked.options.tmpfs ? MemoryDirectory::path : files.in("ledger");
  std::unique_ptr<MemoryDirectory> memory;
  if (asked.options.tmpfs) {
    auto made = MemoryDirectory::make(files);
    if (!made) return failed(made.error().message);
    memory = std::move(*made);
  }
  const Status room = check_space(ledger, launcher::min_ledger_bytes(asked.options), "the ledger of a flight");
  if (!room) return failed(room.error().message);
  if (!asked.options.json.empty()) {  // before the flight, not after it
    const bool there = fs::exists(asked.options.json, error);
    if (!std::ofstream(asked.options.json, std::ios::app)) return failed("--json: cannot write " + asked.options.json);
    if (!there) fs::remove(asked.options.json, error);
  }
  catch_stop_signals({SIGINT, SIGTERM, SIGHUP});
  std::signal(SIGPIPE, SIG_IGN);
  return fly_and_report(asked.options, files);
}
