#include "tools/launcher/switches/switch_service.hpp"

#include <poll.h>

#include "common/rt/clock.hpp"

namespace ledgerline::fly {
namespace {

constexpr int look_ms = 50;  // at what the launcher wants
constexpr TimeNs proxy_timeout_ns = ns_per_s;

}  // namespace

Result<std::unique_ptr<SwitchService>> SwitchService::open(const std::string& socket, std::string proxy,
                                                           const std::vector<std::string>& drones) {
  auto opened = CommandSocket::open(socket);
  if (!opened) return opened.error();
  return std::unique_ptr<SwitchService>(new SwitchService(std::move(*opened), std::move(proxy), drones));
}

SwitchService::SwitchService(CommandSocket socket, std::string proxy, const std::vector<std::string>& drones)
    : socket_(std::move(socket)), proxy_(std::move(proxy)), switches_(drones), thread_([this] { serve(); }) {}

SwitchService::~SwitchService() {
  over_ = true;
  thread_.join();
}

void SwitchService::serve() {
  std::vector<pollfd> polled;
  while (!over_) {
    if (ending_) switches_.end();
    if (off_.exchange(false) || ending_) switch_off();
    polled.clear();
    socket_.add_to(monotonic_ns(), polled);
    ::poll(polled.data(), polled.size(), look_ms);
    socket_.serve(monotonic_ns(), polled, [this](const std::string& command) { return act(command); });
  }
  switch_off();
}

Result<std::string> SwitchService::act(const std::string& command) {
  const auto step = switches_.step_of(command);
  if (!step) return step.error();
  if (*step) {
    switches_.tell(**step);
    if (const auto reported = send_command(proxy_, (*step)->line, proxy_timeout_ns); !reported) return reported.error();
    switches_.done_with(**step);
  }
  return switches_.list();
}

// One that is not switched off stays on the list, and is tried again.
void SwitchService::switch_off() {
  for (const FaultSwitches::Step& step : switches_.steps_off()) {
    if (!send_command(proxy_, step.line, proxy_timeout_ns)) return;
    switches_.done_with(step);
  }
}

}  // namespace ledgerline::fly
