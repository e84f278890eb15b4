#include "ground/service/shell/fault_service.hpp"

#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <iterator>

#include "common/base/log.hpp"
#include "common/program/command_socket.hpp"

namespace ledgerline::ground::service {
namespace {

constexpr TimeNs fault_timeout_ns = 2 * ns_per_s;  // who serves it gives the proxy one
constexpr std::chrono::seconds look_again{1};

ApiAnswer ends() { return refusal(503, "the ground ends"); }

}  // namespace

void FaultService::start(std::function<void(FaultList)> publish) {
  publish_ = std::move(publish);
  thread_ = std::thread([this] { run(); });
}

void FaultService::request(FaultRequest asked, Answer answer) {
  std::deque<Waiting> overtaken;
  bool taken = false;
  {
    const std::lock_guard lock(mutex_);
    // What ends a fault does not wait behind what begins some.
    if (!asked.on) {
      const auto same = [&](const Waiting& one) { return one.first.name == asked.name; };
      std::ranges::copy_if(waiting_, std::back_inserter(overtaken), same);
      std::erase_if(waiting_, same);
    }
    taken = !over_ && waiting_.size() < (asked.on ? max_waiting : 2 * max_waiting);
    if (taken) {
      waiting_.emplace(asked.on ? waiting_.end() : waiting_.begin(), std::move(asked), answer);
      changed_.notify_one();
    }
  }
  for (const Waiting& one : overtaken) one.second(refusal(503, "it was asked to be switched off meanwhile"));
  if (!taken) answer(refusal(503, "too much waits to be switched: try again"));
}

void FaultService::close() {
  std::deque<Waiting> refused;
  {
    const std::lock_guard lock(mutex_);
    over_ = true;
    refused.swap(waiting_);
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  for (const auto& [asked, answer] : refused) answer(ends());
}

void FaultService::run() {
  ::pthread_setname_np(::pthread_self(), "faults");
  std::unique_lock lock(mutex_);
  while (!over_) {
    if (waiting_.empty()) {
      lock.unlock();
      refresh();
      lock.lock();
      changed_.wait_for(lock, look_again, [this] { return over_ || !waiting_.empty(); });
      continue;
    }
    const auto [asked, answer] = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    switch_one(asked, answer);
    lock.lock();
  }
}

void FaultService::refresh() { apply(send_command(socket_, "list", fault_timeout_ns)); }

void FaultService::switch_one(const FaultRequest& asked, const Answer& answer) {
  const auto answered = send_command(socket_, command_of(asked), fault_timeout_ns);
  if (!answered) return answer(refusal(503, "not switched: " + answered.error().message));
  apply(answered);
  const auto what =
      std::ranges::find_if(list_.switches, [&](const FaultSwitch& one) { return one.name == asked.name; });
  if (!list_.why.empty() || what == list_.switches.end()) return answer(refusal(503, "not known: " + list_.why));
  const std::string words = words_of(asked, *what);
  spdlog::warn("{}{}{}", what->drone, what->drone.empty() ? "" : ": ", words);
  report_(asked.on ? Level::warning : Level::info, what->drone, words);
  answer({200, faults_text(list_)});
}

void FaultService::apply(const Result<std::string>& answered) {
  FaultList now;
  const auto list = answered ? faults_from(*answered) : Result<std::vector<FaultSwitch>>(answered.error());
  if (list)
    now.switches = *list;
  else
    now.why = "the faults' switches are not reached: " + list.error().message;
  if (published_ && faults_message(now) == faults_message(list_)) return;
  if (!now.why.empty()) spdlog::warn("{}", now.why);
  published_ = true;
  list_ = now;
  publish_(std::move(now));
}

}  // namespace ledgerline::ground::service
