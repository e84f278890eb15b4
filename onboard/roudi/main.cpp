#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <iceoryx_hoofs/log/logmanager.hpp>
#include <iceoryx_hoofs/posix_wrapper/posix_access_rights.hpp>
#include <iceoryx_posh/iceoryx_posh_config.hpp>
#include <iceoryx_posh/internal/roudi/roudi.hpp>
#include <iceoryx_posh/roudi/iceoryx_roudi_components.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "common/base/log.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/program/service_manager.hpp"
#include "common/program/stop_signals.hpp"
#include "onboard/ipc/roudi_probe.hpp"
#include "onboard/roudi/leak_watch.hpp"

namespace {

// iceoryx' management segment and our pools take 68 MB (66 of them fixed); 96 MB in all leaves room for others.
constexpr std::uint64_t shm_size_needed = 96ULL << 20;
constexpr std::uint64_t shm_free_needed = 72ULL << 20;

std::optional<std::string> shared_memory_problem() {
  struct statvfs info {};
  if (::statvfs("/dev/shm", &info) != 0) {
    return "there is no /dev/shm: mount a tmpfs on it (mount -t tmpfs -o size=128m tmpfs /dev/shm)";
  }
  const std::uint64_t size = static_cast<std::uint64_t>(info.f_blocks) * info.f_frsize;
  const std::uint64_t available = static_cast<std::uint64_t>(info.f_bavail) * info.f_frsize;
  if (size < shm_size_needed) {
    return fmt::format(
        "/dev/shm has {} MB, {} MB are needed: mount -o remount,size=128m /dev/shm (a container: docker run "
        "--shm-size=128m)",
        size >> 20, shm_size_needed >> 20);
  }
  if (available < shm_free_needed) {
    return fmt::format(
        "/dev/shm has {} MB free of {} MB, {} MB are needed: delete leftovers there, or stop what an earlier RouDi "
        "served",
        available >> 20, size >> 20, shm_free_needed >> 20);
  }
  return std::nullopt;
}

using ledgerline::roudi::LeakWatch;

constexpr LeakWatch::Chunks kept_by_publishers{2, 2, 1};  // of the pools below
constexpr long look_period_ns = 250'000'000;

// The user group is the reader's and the writer's: all processes of Ledgerline run as one user.
iox::RouDiConfig_t small_pools() {
  iox::mepoo::MePooConfig pools;
  pools.addMemPool({128, 1024});   // poses, transitions
  pools.addMemPool({384, 1024});   // states, beats
  pools.addMemPool({1280, 1024});  // plans
  const auto group = iox::posix::PosixGroup::getGroupOfCurrentProcess().getName();
  iox::RouDiConfig_t config;
  config.m_sharedMemorySegments.push_back({group, group, pools});
  return config;
}

std::string segment_name() { return std::string(iox::posix::PosixGroup::getGroupOfCurrentProcess().getName().c_str()); }

LeakWatch::Chunks chunks_in_use(iox::mepoo::MemoryManager& memory) {
  LeakWatch::Chunks used{};
  for (std::uint32_t i = 0; i < used.size(); ++i) used[i] = memory.getMemPoolInfo(i).m_usedChunks;
  return used;
}

/// Until SIGINT or SIGTERM, which it returns. What is found out is said when it changes.
int serve(const sigset_t& signals, iox::mepoo::MemoryManager& memory, LeakWatch& watch, int results) {
  for (std::uint32_t said = 0;;) {
    const timespec period{0, look_period_ns};
    const int signal = ::sigtimedwait(&signals, nullptr, &period);
    if (signal > 0) return signal;
    watch.look(chunks_in_use(memory));
    if (watch.leaked() == said) continue;
    if (said == 0) {
      spdlog::warn(
          "{} chunks of shared memory stay in use, of processes that were killed or of a reader that stands still; the "
          "cure for the first: start RouDi, link and agent anew while nothing flies",
          watch.leaked());
    }
    said = watch.leaked();
    ::dprintf(results, "{\"leaked\":%u}\n", said);
  }
}

bool write_summary(const std::string& path, const LeakWatch::Chunks& used, const LeakWatch& watch) {
  if (path.empty()) return true;
  std::ofstream file(path);
  file << nlohmann::json{{"chunks_in_use", used}, {"leaked", watch.leaked()}, {"leaked_at_most", watch.most()}}.dump(2)
       << "\n";
  file.close();
  if (!file) spdlog::error("cannot write {}", path);
  return static_cast<bool>(file);
}

bool answers_within(std::chrono::milliseconds bound) {
  for (auto waited = std::chrono::milliseconds(0); waited < bound; waited += std::chrono::milliseconds(2)) {
    if (ledgerline::ipc::probe("roudi") == ledgerline::ipc::Peer::alive) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return false;
}

constexpr const char* about =
    "Shared memory between link and agent: iceoryx' RouDi with small pools. One runs per machine.";
constexpr const char* notes = R"(Examples:
  ledgerline-roudi                 serve until SIGTERM
A line {"leaked":N} on standard output says that N chunks were lost with processes that were killed.
Exit codes: 0 stopped by a signal, 1 cannot serve or write the summary, 2 bad usage)";

}  // namespace

int main(int argc, char** argv) {
  ledgerline::CommandLine line("roudi", about, notes);
  std::string summary;
  line.option("--summary", summary, "Write here at the end: chunks in use by size, and how many were lost");
  if (const auto end = line.parse(argc, argv)) return *end;
  // iceoryx writes banners to standard output, from a thread of its own too: results go to the real one, the rest to
  // standard error.
  const int results = ::dup(STDOUT_FILENO);
  ::dup2(STDERR_FILENO, STDOUT_FILENO);
  iox::log::LogManager::GetLogManager().SetDefaultLogLevel(iox::log::LogLevel::kError);

  auto manager = ledgerline::ServiceManager::from_environment();
  if (!manager) return ledgerline::fail(manager.error());
  if (ledgerline::ipc::probe("roudi") != ledgerline::ipc::Peer::gone) {
    spdlog::error("another RouDi runs already on this machine: stop it first");
    return 1;
  }
  // What a killed RouDi left behind is not counted against the new one.
  ::shm_unlink("/iceoryx_mgmt");
  ::shm_unlink(("/" + segment_name()).c_str());
  if (const auto problem = shared_memory_problem()) {
    spdlog::error("{}", *problem);
    return 1;
  }

  // Blocked before any thread starts, so that only sigwait below sees them.
  const sigset_t signals = ledgerline::block_signals();

  // Never destroyed: its destructor would run over ports that other processes still use. See below.
  auto* components = new iox::roudi::IceOryxRouDiComponents(small_pools());
  new iox::roudi::RouDi(components->rouDiMemoryManager, components->portManager,
                        iox::roudi::RouDi::RoudiStartupParameters{iox::roudi::MonitoringMode::OFF, false});
  // Its thread opens the socket; ready is when others may connect.
  if (!answers_within(std::chrono::seconds(5))) {
    spdlog::error("RouDi did not open /tmp/roudi within 5 s: is /tmp writable?");
    ::_exit(1);
  }
  ::dprintf(results, "{\"ready\":true,\"program\":\"ledgerline-roudi\"}\n");
  if (auto status = manager->ready(); !status) spdlog::error("{}", status.error().what);

  const auto segments = components->rouDiMemoryManager.segmentManager();
  const auto segment =
      (*segments)->getSegmentInformationWithWriteAccessForUser(iox::posix::PosixUser::getUserOfCurrentProcess());
  iox::mepoo::MemoryManager& memory = segment.m_memoryManager->get();
  LeakWatch watch(kept_by_publishers);
  const int signal = serve(signals, memory, watch, results);
  const bool written = write_summary(summary, chunks_in_use(memory), watch);
  spdlog::info("stopped by {}", signal == SIGINT ? "SIGINT" : "SIGTERM");
  // Memory that others have mapped stays theirs until they end; only the names go, so that nothing is left behind.
  ::shm_unlink("/iceoryx_mgmt");
  ::shm_unlink(("/" + segment_name()).c_str());
  ::unlink("/tmp/roudi");
  ::unlink("/tmp/roudi.lock");
  ::unlink("/tmp/iox-unique-roudi.lock");
  std::fflush(nullptr);
  ::_exit(written ? 0 : 1);
}
