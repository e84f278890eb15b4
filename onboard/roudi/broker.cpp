#include "onboard/roudi/broker.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include <iceoryx_hoofs/log/logmanager.hpp>
#include <iceoryx_hoofs/posix_wrapper/posix_access_rights.hpp>
#include <iceoryx_posh/iceoryx_posh_config.hpp>
#include <iceoryx_posh/internal/roudi/roudi.hpp>
#include <iceoryx_posh/roudi/iceoryx_roudi_components.hpp>
#include <string>

#include "common/rt/retry.hpp"
#include "onboard/ipc/ipc.hpp"
#include "onboard/ipc/roudi_probe.hpp"
#include "onboard/roudi/host_check.hpp"

namespace ledgerline::roudi {
namespace {

// Its thread opens the socket within milliseconds; who waits for it wants to know at once.
constexpr TryLimits until_it_answers{
    .within_ns = 5 * ns_per_s, .first_pause_ns = 2 * ns_per_ms, .max_pause_ns = 2 * ns_per_ms};

std::string user_group() { return iox::posix::PosixGroup::getGroupOfCurrentProcess().getName().c_str(); }

// The user group is the reader's and the writer's: all processes of Ledgerline run as one user.
iox::RouDiConfig_t small_pools() {
  iox::mepoo::MePooConfig pools;
  pools.addMemPool({128, 1024});  // poses, transitions
  pools.addMemPool({384, 1024});  // states, heartbeats
  pools.addMemPool({ipc::plan_chunk_bytes, 1024});
  const auto group = iox::posix::PosixGroup::getGroupOfCurrentProcess().getName();
  iox::RouDiConfig_t config;
  config.m_sharedMemorySegments.push_back({group, group, pools});
  return config;
}

void unlink_segments() {
  ::shm_unlink("/iceoryx_mgmt");
  ::shm_unlink(("/" + user_group()).c_str());
}

}  // namespace

Result<Broker> Broker::start() {
  iox::log::LogManager::GetLogManager().SetDefaultLogLevel(iox::log::LogLevel::kError,
                                                           iox::log::LogLevelOutput::kHideLogLevel);
  if (const Status alone = check_no_other(); !alone) return alone.error();
  if (const Status served = check_group(group_of_process()); !served) return served.error();
  if (const Status writable = check_writable(); !writable) return writable.error();
  unlink_segments();
  if (const Status room = check_shared_memory(); !room) return room.error();

  auto* components = new iox::roudi::IceOryxRouDiComponents(small_pools());
  new iox::roudi::RouDi(components->rouDiMemoryManager, components->portManager,
                        iox::roudi::RouDi::RoudiStartupParameters{iox::roudi::MonitoringMode::OFF, false});
  const Status answers = retry(
      "RouDi answers", until_it_answers, [] { return false; },
      []() -> Status {
        if (ipc::probe("roudi") == ipc::Peer::alive) return done;
        return Error{"it does not open /tmp/roudi: is /tmp writable?"};
      });
  if (!answers) return answers.error();
  const auto segments = components->rouDiMemoryManager.segmentManager();
  const auto segment =
      (*segments)->getSegmentInformationWithWriteAccessForUser(iox::posix::PosixUser::getUserOfCurrentProcess());
  return Broker(segment.m_memoryManager->get());
}

LeakWatch::Chunks Broker::chunks_in_use() const {
  LeakWatch::Chunks used{};
  for (std::uint32_t i = 0; i < used.size(); ++i) used[i] = memory_->getMemPoolInfo(i).m_usedChunks;
  return used;
}

void Broker::remove_names() {
  unlink_segments();
  ::unlink("/tmp/roudi");
  ::unlink("/tmp/roudi.lock");
  ::unlink("/tmp/iox-unique-roudi.lock");
}

}  // namespace ledgerline::roudi
