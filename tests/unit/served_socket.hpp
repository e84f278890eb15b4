#pragma once
#include <poll.h>

#include <atomic>
#include <thread>
#include <utility>
#include <vector>

#include "common/program/command_socket.hpp"

namespace ledgerline {

/// Serves a socket until it goes.
class ServedSocket {
 public:
  ServedSocket(CommandSocket socket, CommandSocket::Do act)
      : socket_(std::move(socket)), act_(std::move(act)), thread_([this] { serve(); }) {}
  ~ServedSocket() {
    end_ = true;
    thread_.join();
  }

 private:
  void serve() {
    while (!end_) {
      std::vector<pollfd> polled;
      socket_.add_to(monotonic_ns(), polled);
      ::poll(polled.data(), polled.size(), 5);
      socket_.serve(monotonic_ns(), polled, act_);
    }
  }
  CommandSocket socket_;
  CommandSocket::Do act_;
  std::atomic<bool> end_{false};
  std::thread thread_;
};

}  // namespace ledgerline
