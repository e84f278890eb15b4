#include "onboard/ipc/ipc.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <future>
#include <iostream>
#include <thread>
#include <utility>

#include <iceoryx_hoofs/log/logmanager.hpp>
#include <iceoryx_posh/popo/publisher.hpp>
#include <iceoryx_posh/popo/subscriber.hpp>
#include <iceoryx_posh/runtime/posh_runtime.hpp>

#include "onboard/ipc/bounded_lines.hpp"
#include "onboard/ipc/roudi_probe.hpp"

namespace ledgerline::ipc {
namespace {

constexpr const char* roudi_name = "roudi";
// Beside the sockets of iceoryx, so that who shares those shares it, too.
constexpr const char* agent_wakeup = "/tmp/ledgerline-agent.wakeup";
std::uint64_t roudi_inode = 0;  // set once in connect(), before any thread

// No history anywhere: a plan or pose from before the reader came is not to be flown. Queues hold what may gather while
// the reader is stopped for a moment; then the oldest is lost, as sequence numbers show; transitions come again.
constexpr std::uint64_t plan_queue = 128;
constexpr std::uint64_t pose_queue = 256;
constexpr std::uint64_t heartbeat_queue = 32;  // two of each channel that an agent may be on
constexpr std::uint64_t state_queue = 256;
constexpr std::uint64_t transition_queue = 256;

// The version is part of the name: processes of different builds do not misread each other's plain data.
iox::capro::ServiceDescription channel(const char* name, std::size_t size) {
  const std::string version = fmt::format("v2-{}", size);
  return {"ledgerline", iox::capro::IdString_t(iox::cxx::TruncateToCapacity, version),
          iox::capro::IdString_t(iox::cxx::TruncateToCapacity, std::string(name))};
}

// While this lives iceoryx's banners go to standard error. Before other threads write.
class QuietStdout {
 public:
  QuietStdout() : saved_(::dup(STDOUT_FILENO)) {
    std::fflush(stdout);
    ::dup2(STDERR_FILENO, STDOUT_FILENO);
  }
  QuietStdout(const QuietStdout&) = delete;
  QuietStdout& operator=(const QuietStdout&) = delete;
  ~QuietStdout() {
    std::fflush(stdout);
    ::dup2(saved_, STDOUT_FILENO);
    ::close(saved_);
  }

 private:
  int saved_;
};

template <typename T>
class Sender {
 public:
  explicit Sender(const char* name) : publisher_(channel(name, sizeof(T))) {}
  bool send(const T& value) noexcept { return !publisher_.publishCopyOf(value).has_error(); }

 private:
  iox::popo::Publisher<T> publisher_;
};

template <typename T>
class Receiver {
 public:
  Receiver(const char* name, std::uint64_t depth)
      : subscriber_(channel(name, sizeof(T)), iox::popo::SubscriberOptions{.queueCapacity = depth}) {}
  bool take(T& out) noexcept {
    auto sample = subscriber_.take();
    if (sample.has_error()) return false;
    out = **sample;
    return true;
  }

 private:
  iox::popo::Subscriber<T> subscriber_;
};

class IceoryxLinkEnd final : public LinkEnd {
 public:
  explicit IceoryxLinkEnd(WakeupSource agent) : agent_(std::move(agent)) {}
  bool receive_plan(Plan& out) noexcept override { return plans_.take(out); }
  bool receive_pose(Pose& out) noexcept override { return poses_.take(out); }
  bool receive_heartbeat(AgentHeartbeat& out) noexcept override { return heartbeats_.take(out); }
  bool send_state(const StateSample& sample) noexcept override { return states_.send(sample); }
  bool send_transition(const Transition& transition) noexcept override { return transitions_.send(transition); }
  void wake_agent() noexcept override { agent_.notify(); }

 private:
  Receiver<Plan> plans_{"plan", plan_queue};
  Receiver<Pose> poses_{"pose", pose_queue};
  Receiver<AgentHeartbeat> heartbeats_{"heartbeat", heartbeat_queue};
  Sender<StateSample> states_{"state"};
  Sender<Transition> transitions_{"transition"};
  WakeupSource agent_;
};

class IceoryxAgentEnd final : public AgentEnd {
 public:
  explicit IceoryxAgentEnd(std::unique_ptr<WakeupSink> wakeup) : wakeup_(std::move(wakeup)) {}
  bool receive_state(StateSample& out) noexcept override { return states_.take(out); }
  bool receive_transition(Transition& out) noexcept override { return transitions_.take(out); }
  bool send_plan(const Plan& plan) noexcept override { return plans_.send(plan); }
  bool send_pose(const Pose& pose) noexcept override { return poses_.send(pose); }
  bool send_heartbeat(const AgentHeartbeat& heartbeat) noexcept override { return heartbeats_.send(heartbeat); }
  int wake_fd() const noexcept override { return wakeup_->fd(); }
  bool woken() noexcept override { return wakeup_->clear(); }

 private:
  Receiver<StateSample> states_{"state", state_queue};
  Receiver<Transition> transitions_{"transition", transition_queue};
  Sender<Plan> plans_{"plan"};
  Sender<Pose> poses_{"pose"};
  Sender<AgentHeartbeat> heartbeats_{"heartbeat"};
  std::unique_ptr<WakeupSink> wakeup_;
};

}  // namespace

Status connect(const std::string& program, const std::function<bool()>& is_asked_to_end) {
  const QuietStdout quiet;
  iox::log::LogManager::GetLogManager().SetDefaultLogLevel(iox::log::LogLevel::kError,
                                                           iox::log::LogLevelOutput::kHideLogLevel);
  switch (probe(roudi_name)) {
    case Peer::alive:
      break;
    case Peer::forbidden:
      return Error{
          "RouDi runs as another user, and shared memory is for one user alone: start ledgerline-roudi and this "
          "program as the same user (or remove /tmp/roudi, if nobody knows it)"};
    case Peer::gone:
      return Error{"RouDi does not answer (/tmp/roudi): start ledgerline-roudi first"};
  }
  // iceoryx would end this process with an assertion.
  if (auto status = check_names({program, program + ".lock"}); !status) return status;
  if (probe(program) == Peer::alive)
    return Error{fmt::format("another {} runs already on this machine: stop it first", program)};
  roudi_inode = socket_inode(roudi_name);
  static auto* const bounded = new BoundedLines(*std::cerr.rdbuf());  // for as long as iceoryx's threads may write
  std::cerr.rdbuf(bounded);
  auto answered = std::make_shared<std::promise<void>>();
  std::thread([answered, program] {
    iox::runtime::PoshRuntime::initRuntime(iox::RuntimeName_t(iox::cxx::TruncateToCapacity, program));
    answered->set_value();
  }).detach();
  constexpr std::chrono::milliseconds look{10};
  for (auto answer = answered->get_future(); answer.wait_for(look) != std::future_status::ready;) {
    if (is_asked_to_end && is_asked_to_end()) return Error{"asked to end while RouDi did not answer"};
  }
  return done;
}

bool is_roudi_alive() { return probe(roudi_name) == Peer::alive && socket_inode(roudi_name) == roudi_inode; }

Result<std::unique_ptr<LinkEnd>> LinkEnd::create() {
  auto agent = WakeupSource::create(agent_wakeup);
  if (!agent) return agent.error();
  return std::unique_ptr<LinkEnd>(std::make_unique<IceoryxLinkEnd>(std::move(*agent)));
}

Result<std::unique_ptr<AgentEnd>> AgentEnd::create() {
  auto wakeup = WakeupSink::create(agent_wakeup);
  if (!wakeup) return wakeup.error();
  return std::unique_ptr<AgentEnd>(std::make_unique<IceoryxAgentEnd>(std::move(*wakeup)));
}

}  // namespace ledgerline::ipc
