#pragma once
#include <array>
#include <cstddef>
#include <deque>
#include <map>
#include <string>
#include <utility>

namespace ledgerline::node {

/// For whom a task is done, as the request says. Nothing of it is checked yet: who claims another's name waits in that
/// one's line, and is refused when its turn comes, for the price of a signature.
struct Requester {
  std::string msp_id;    ///< empty: of nobody that is known
  std::string identity;  ///< msp.SerializedIdentity
};

/// Tasks that wait for the core, each requester's in a line of its own. Organisations have turns, and within one its
/// identities, so that who asks much, or under many names, waits behind who asks little. Not thread-safe.
template <typename Task>
class TaskTurns {
 public:
  void push(const Requester& requester, Task task) {
    organisations_.line(requester.msp_id).line(requester.identity).push_back(std::move(task));
    ++size_;
  }
  /// The next one. Only where one waits.
  Task pop() {
    --size_;
    return organisations_.next([](Identities& identities) {
      return identities.next([](std::deque<Task>& line) {
        Task task = std::move(line.front());
        line.pop_front();
        return task;
      });
    });
  }
  bool empty() const { return size_ == 0; }
  std::size_t size() const { return size_; }

 private:
  /// Lines by name that are served in turn, each once a round. An empty one is gone.
  template <typename Line>
  class Lines {
   public:
    Line& line(const std::string& name) {
      const auto [one, is_new] = lines_.try_emplace(name);
      if (is_new) turns_.push_back(name);
      return one->second;
    }
    bool empty() const { return lines_.empty(); }
    template <typename Serve>
    Task next(Serve serve) {
      std::string name = std::move(turns_.front());
      turns_.pop_front();
      const auto one = lines_.find(name);
      Task task = serve(one->second);
      if (one->second.empty()) {
        lines_.erase(one);
      } else {
        turns_.push_back(std::move(name));
      }
      return task;
    }

   private:
    std::map<std::string, Line> lines_;
    std::deque<std::string> turns_;
  };
  using Identities = Lines<std::deque<Task>>;

  Lines<Identities> organisations_;
  std::size_t size_ = 0;
};

/// Who waits for commands and states goes first; who only asks comes after them (but is not kept waiting for ever).
enum class Turn { first, later };

/// All tasks that wait for the core. Not thread-safe.
template <typename Task>
class TaskQueue {
 public:
  void push(Turn turn, const Requester& requester, Task task) { of(turn).push(requester, std::move(task)); }
  /// The next one. Only where one waits.
  Task pop() {
    // Now and then a question has its turn though others wait, so that it is answered at all.
    const bool question = of(Turn::first).empty() || (!of(Turn::later).empty() && ++in_a_row_ >= max_in_a_row);
    if (question) in_a_row_ = 0;
    return of(question ? Turn::later : Turn::first).pop();
  }
  bool empty() const { return turns_[0].empty() && turns_[1].empty(); }
  bool is_full(Turn turn) { return of(turn).size() >= max_tasks; }

 private:
  static constexpr std::size_t max_tasks = 4096;
  static constexpr int max_in_a_row = 16;

  TaskTurns<Task>& of(Turn turn) { return turns_[static_cast<std::size_t>(turn)]; }

  std::array<TaskTurns<Task>, 2> turns_;  ///< by Turn
  int in_a_row_ = 0;
};

}  // namespace ledgerline::node
