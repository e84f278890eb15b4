#pragma once
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <csignal>
#include <cstdint>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "common/dds/dds.hpp"

namespace ledgerline::dds {

/// Domains of parallel test runs on one machine keep apart.
inline std::uint32_t own_domain() { return 100 + static_cast<std::uint32_t>(getpid()) % 100; }
inline ParticipantOptions on_own_domain() {
  ParticipantOptions options;
  options.domain = own_domain();
  return options;
}

using Bytes = std::vector<std::uint8_t>;
inline Bytes copy_of(std::span<const std::uint8_t> bytes) { return {bytes.begin(), bytes.end()}; }

/// CDR of `size` bytes, header included, that tells `number`.
inline Bytes message_of(std::size_t size, std::uint32_t number, bool little_endian = true) {
  Bytes bytes(size);
  for (std::size_t i = 4; i < size; ++i) bytes[i] = static_cast<std::uint8_t>((number >> 8 * (i % 4)) ^ (i / 4 * 31));
  bytes[1] = little_endian;
  return bytes;
}

/// Waits as long as it takes something that will come: 20 s.
template <typename Condition>
bool eventually(Condition condition) {
  for (int i = 0; i < 2000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return condition();
}

/// Collects from DDS's thread.
template <typename Item>
class Inbox {
 public:
  void add(Item item) {
    const std::lock_guard lock(mutex_);
    items_.push_back(std::move(item));
    changed_.notify_all();
  }
  bool wait_for(std::size_t count) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, std::chrono::seconds(20), [&] { return items_.size() >= count; });
  }
  std::vector<Item> items() {
    const std::lock_guard lock(mutex_);
    return items_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Item> items_;
};

/// This test program again, running one of its disabled tests; ended with the object.
class OtherProcess {
 public:
  explicit OtherProcess(const std::string& test, std::vector<std::string> environment = {}) {
    std::string program = "/proc/self/exe", filter = "--gtest_filter=" + test, also = "--gtest_also_run_disabled_tests";
    char* const arguments[] = {program.data(), filter.data(), also.data(), nullptr};
    environment.push_back("ROS_DOMAIN_ID=" + std::to_string(own_domain()));
    for (char** entry = environ; *entry; ++entry) environment.emplace_back(*entry);
    std::vector<char*> pointers;
    for (std::string& entry : environment) pointers.push_back(entry.data());
    pointers.push_back(nullptr);
    if (posix_spawn(&pid_, program.c_str(), nullptr, nullptr, arguments, pointers.data()) != 0) pid_ = 0;
  }
  ~OtherProcess() {
    if (pid_ <= 0) return;
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  OtherProcess(const OtherProcess&) = delete;
  OtherProcess& operator=(const OtherProcess&) = delete;
  bool started() const { return pid_ > 0; }

 private:
  pid_t pid_ = 0;
};

}  // namespace ledgerline::dds
