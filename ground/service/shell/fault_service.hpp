#pragma once
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "ground/service/core/api.hpp"

namespace ledgerline::ground::service {

/// Asks who serves [service] faults for what people switch, and each second for what is on; on a thread of its own, so
/// that nobody else waits for it. Any thread.
class FaultService {
 public:
  using Answer = std::function<void(ApiAnswer)>;
  /// Something was switched; `drone`: whose, empty: of all. On the service's thread.
  using Report = std::function<void(Level level, const std::string& drone, std::string words)>;
  static constexpr std::size_t max_waiting = 8;  ///< twice as many to be switched off

  FaultService(std::string socket, Report report) : socket_(std::move(socket)), report_(std::move(report)) {}
  ~FaultService() { close(); }

  /// `publish`: the list has changed; on the service's thread. Once.
  void start(std::function<void(FaultList)> publish);
  /// `answer` comes exactly once, on the service's thread or, where too much waits, at once.
  void request(FaultRequest asked, Answer answer);
  /// Waits for what is asked just now, some seconds at most; what waits is refused.
  void close();

 private:
  using Waiting = std::pair<FaultRequest, Answer>;
  void run();
  void refresh();
  void switch_one(const FaultRequest& asked, const Answer& answer);
  void apply(const Result<std::string>& answered);

  const std::string socket_;
  const Report report_;
  std::function<void(FaultList)> publish_;
  FaultList list_;  ///< the thread's, as published last
  bool published_ = false;

  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Waiting> waiting_;  ///< what is to be switched off first
  bool over_ = false;
  std::thread thread_;  ///< uses all of the above
};

}  // namespace ledgerline::ground::service
