#pragma once
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <utility>

namespace ledgerline::ground::service {

/// Brings what other threads answer to the server's thread. A connection that waits for an answer belongs to that
/// thread alone: another one neither uses nor ends it, whenever it answers. An answer behind the server's end is
/// dropped.
class Answers {
 public:
  explicit Answers(boost::asio::io_context& io) : door_(std::make_shared<AnswerGate>(io)) {}
  ~Answers() { close(); }
  Answers(const Answers&) = delete;
  Answers& operator=(const Answers&) = delete;

  /// What `then` gets is what the returned function is called with, once; `then` runs and ends on the server's thread.
  /// The returned function: any thread, and whenever it likes. Server's thread.
  template <typename Answer>
  std::function<void(Answer)> expect(std::function<void(Answer)> then) {
    const auto waits = std::make_shared<std::function<void(Answer)>>(std::move(then));
    waiting_.insert(waits);
    return [this, door = door_, waits = std::weak_ptr(waits)](Answer answer) {
      door->post([this, waits, answer = std::move(answer)]() mutable {
        const auto found = waits.lock();
        if (found && waiting_.erase(found) > 0) (*found)(std::move(answer));
      });
    };
  }

  /// Nobody waits any longer. When the server's thread has ended, and before its io_context does.
  void close() {
    door_->close();
    waiting_.clear();
  }

 private:
  class AnswerGate {
   public:
    explicit AnswerGate(boost::asio::io_context& io) : io_(&io) {}
    template <typename Work>
    void post(Work work) {
      const std::lock_guard lock(mutex_);
      if (io_) boost::asio::post(*io_, std::move(work));
    }
    void close() {
      const std::lock_guard lock(mutex_);
      io_ = nullptr;
    }

   private:
    std::mutex mutex_;
    boost::asio::io_context* io_;
  };

  const std::shared_ptr<AnswerGate> door_;
  std::set<std::shared_ptr<void>> waiting_;
};

}  // namespace ledgerline::ground::service
