#include "onboard/link/shell/publisher_thread.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <vector>

namespace ledgerline::link {
namespace {

/// What agent receives; it can block the sender, as a lock does whose holder was killed.
struct FakeEnd final : ipc::LinkEnd {
  bool receive_plan(Plan&) noexcept override { return false; }
  bool receive_pose(Pose&) noexcept override { return false; }
  bool receive_heartbeat(AgentHeartbeat&) noexcept override { return false; }
  bool send_state(const StateSample& sample) noexcept override {
    sending = true;
    while (holds) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    if (full) return false;
    heard.push_back(sample.sequence);
    return true;
  }
  bool send_transition(const Transition& transition) noexcept override {
    transitions.push_back(transition.number);
    return true;
  }
  void wake_agent() noexcept override { heard_when_woken = heard.size() + transitions.size(); }
  std::atomic<bool> sending{false}, holds{false}, full{false};
  std::size_t heard_when_woken = 0;
  std::vector<std::uint64_t> heard, transitions;
};

StateSample state(std::uint64_t sequence) {
  StateSample sample;
  sample.drone = 2;
  sample.sequence = sequence;
  return sample;
}

TEST(PublisherThread, CarriesEverythingInOrderBeforeItEnds) {
  FakeEnd end;
  {
    auto publisher = PublisherThread::start(end, 0);
    ASSERT_TRUE(publisher);
    for (std::uint64_t i = 1; i <= 100; ++i) {
      (*publisher)->put(state(i));
      if (i % 10 == 0) (*publisher)->wake();
    }
    EXPECT_EQ((*publisher)->lost(2), 0U);
  }
  ASSERT_EQ(end.heard.size(), 100U);
  for (std::uint64_t i = 0; i < 100; ++i) EXPECT_EQ(end.heard[i], i + 1);
}

TEST(PublisherThread, AgentIsWokenBehindWhateverItIsToHear) {
  FakeEnd end;
  {
    auto publisher = PublisherThread::start(end, 0);
    ASSERT_TRUE(publisher);
    for (std::uint64_t i = 1; i <= 20; ++i) (*publisher)->put(state(i));
    (*publisher)->put(Transition{});
    (*publisher)->wake();
  }
  EXPECT_EQ(end.heard_when_woken, 21U);
  FakeEnd closed;
  closed.full = true;
  {
    auto publisher = PublisherThread::start(closed, 0);
    ASSERT_TRUE(publisher);
    (*publisher)->put(state(1));
    (*publisher)->wake();
  }
  EXPECT_EQ(closed.heard_when_woken, 0U) << "nothing came through: there is nothing to look at";
}

TEST(PublisherThread, CarriesTransitionsInOrderToo) {
  FakeEnd end;
  {
    auto publisher = PublisherThread::start(end, 0);
    ASSERT_TRUE(publisher);
    for (std::uint64_t i = 1; i <= 100; ++i) {
      Transition transition;
      transition.number = i;
      (*publisher)->put(transition);
    }
    (*publisher)->wake();
  }
  ASSERT_EQ(end.transitions.size(), 100U);
  for (std::uint64_t i = 0; i < 100; ++i) EXPECT_EQ(end.transitions[i], i + 1);
}

TEST(PublisherThread, AnEndThatHoldsItHoldsNobodyElse) {
  FakeEnd end;
  end.holds = true;
  auto publisher = PublisherThread::start(end, 0);
  ASSERT_TRUE(publisher);
  (*publisher)->put(state(1));
  (*publisher)->wake();
  while (!end.sending) std::this_thread::yield();
  // More than its ring and its socket take: the loop goes on, and what is lost is counted.
  for (std::uint64_t i = 2; i <= 1000; ++i) {
    (*publisher)->put(state(i));
    (*publisher)->wake();
  }
  const std::uint64_t lost = (*publisher)->lost(2);
  EXPECT_GT(lost, 0U);
  end.holds = false;
  publisher->reset();
  EXPECT_EQ(end.heard.size() + lost, 1000U);
}

TEST(PublisherThread, CountsWhatFindsNoChunk) {
  FakeEnd end;
  end.full = true;
  auto publisher = PublisherThread::start(end, 0);
  ASSERT_TRUE(publisher);
  (*publisher)->put(state(1));
  (*publisher)->wake();
  while ((*publisher)->lost(2) == 0) std::this_thread::yield();
  EXPECT_EQ((*publisher)->lost(1), 0U);
}

}  // namespace
}  // namespace ledgerline::link
