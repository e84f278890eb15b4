#include "onboard/link/shell/publisher_thread.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>

#include "common/rt/loop_ticker.hpp"

namespace ledgerline::link {

Result<std::unique_ptr<PublisherThread>> PublisherThread::start(ipc::LinkEnd& end, int priority, bool looks) {
  int fds[2];
  if (::socketpair(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0, fds) != 0)
    return Error{fmt::format("no pair of sockets: {}", std::strerror(errno))};
  std::unique_ptr<PublisherThread> publisher(new PublisherThread(end, fds[0], fds[1], looks));
  publisher->thread_ = std::thread([made = publisher.get(), priority] {
    ::pthread_setname_np(::pthread_self(), "publisher");
    // Where it is refused, the loop was refused too, and said so.
    if (priority > 0) (void)schedule_fifo(priority);
    made->run();
  });
  return publisher;
}

PublisherThread::~PublisherThread() {
  stop_.store(true, std::memory_order_release);
  wake();
  thread_.join();
  ::close(loop_fd_);
  ::close(own_fd_);
}

void PublisherThread::put(const StateSample& state) noexcept {
  if (!ring_.push(state)) count_lost(state.drone);
}

// A full socket wakes as well as a fuller one would.
void PublisherThread::wake() noexcept {
  if (!looks_) (void)!::send(loop_fd_, "", 1, MSG_DONTWAIT | MSG_NOSIGNAL);
}

void PublisherThread::wait() const noexcept {
  constexpr timespec look{0, ns_per_ms};
  char byte = 0;
  if (looks_)
    (void)::nanosleep(&look, nullptr);
  else
    (void)!::recv(own_fd_, &byte, 1, 0);
}

void PublisherThread::run() noexcept {
  for (bool last = false; !last;) {
    wait();
    last = stop_.load(std::memory_order_acquire);
    bool sent = false;
    // Before the states: nothing that concerns safety waits behind them.
    for (Transition transition; transitions_.pop(transition);) sent = end_.send_transition(transition) || sent;
    for (StateSample state; ring_.pop(state);) {
      const bool gone = end_.send_state(state);
      if (!gone) count_lost(state.drone);
      sent = sent || gone;
    }
    if (sent) end_.wake_agent();
  }
}

}  // namespace ledgerline::link
