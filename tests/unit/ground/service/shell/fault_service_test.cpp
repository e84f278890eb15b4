#include "ground/service/shell/fault_service.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <optional>

#include "tests/unit/served_socket.hpp"

namespace ledgerline::ground::service {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

/// Whom it asks has one switch, and says what it was asked.
class FaultServiceTest : public testing::Test {
 protected:
  ~FaultServiceTest() override {
    service.close();
    served_.reset();
    ::rmdir(path_.c_str());
  }
  void serve() {
    auto socket = CommandSocket::open(at());
    ASSERT_TRUE(socket) << socket.error().message;
    served_.emplace(std::move(*socket), [this](const std::string& command) -> Result<std::string> {
      if (command.ends_with("sealed")) return Error{"it is sealed"};
      if (command != "list") on_ = command == "on silent";
      return std::string(R"({"faults":[{"name":"silent","drone":"tello1","label":"Silent","words":"w","on":)") +
             (on_ ? "true}]}\n" : "false}]}\n");
    });
  }
  void start() {
    service.start([this](FaultList list) { note(list.why.empty() ? faults_text(list) : list.why); });
  }
  ApiAnswer ask(const std::string& name, bool on) {
    std::optional<ApiAnswer> answer;
    service.request({.name = name, .on = on, .by = "alice"}, [&](ApiAnswer made) {
      const std::lock_guard lock(mutex_);
      answer = std::move(made);
    });
    wait([&] { return answer.has_value(); });
    return *answer;
  }
  template <typename Condition>
  void wait(const Condition& condition) {
    for (int i = 0; i < 1000; ++i) {
      {
        const std::lock_guard lock(mutex_);
        if (condition()) return;
      }
      ::usleep(10'000);
    }
    FAIL() << "it never happens";
  }
  void note(std::string words) {
    const std::lock_guard lock(mutex_);
    reported.push_back(std::move(words));
  }
  std::string at() const { return path_ + "/switches.sock"; }

  static std::string made() {
    char name[] = "/tmp/ledgerline-faults-XXXXXX";
    return ::mkdtemp(name);
  }
  const std::string path_ = made();
  std::mutex mutex_;
  std::vector<std::string> reported;  ///< what was published and said
  std::atomic<bool> on_{false};
  std::optional<ServedSocket> served_;
  FaultService service{at(), [this](Level level, const std::string& drone, std::string words) {
                         note(drone + (level == Level::warning ? " warning " : " info ") + words);
                       }};
};

TEST_F(FaultServiceTest, ListsAndSwitchesFaultsAndReportsWho) {
  serve();
  start();
  wait([&] { return reported.size() == 1; });
  const ApiAnswer on = ask("silent", true);
  EXPECT_EQ(on.status, 200U);
  EXPECT_THAT(on.body, HasSubstr("\"on\":true"));
  EXPECT_EQ(ask("silent", false).status, 200U);
  EXPECT_THAT(reported, ElementsAre(HasSubstr("\"on\":false"), HasSubstr("\"on\":true"),
                                    "tello1 warning Silent: switched on by alice", HasSubstr("\"on\":false"),
                                    "tello1 info Silent: switched off by alice"));
}

TEST_F(FaultServiceTest, SeesWhatOthersSwitch) {
  serve();
  start();
  wait([&] { return reported.size() == 1; });
  on_ = true;
  wait([&] { return reported.size() == 2; });
  EXPECT_THAT(reported.back(), HasSubstr("\"on\":true"));
}

TEST_F(FaultServiceTest, SaysWhyNothingIsSwitched) {
  start();
  wait([&] { return reported.size() == 1; });
  EXPECT_THAT(reported.back(), HasSubstr("are not reached"));
  EXPECT_EQ(ask("silent", true).status, 503U);
  serve();
  wait([&] { return reported.size() == 2; });
  const ApiAnswer sealed = ask("sealed", true);
  EXPECT_EQ(sealed.status, 503U);
  EXPECT_THAT(sealed.body, HasSubstr("it is sealed"));
}

TEST_F(FaultServiceTest, TakesNoMoreThanItsQueueHoldsAndAnswersEachOnce) {
  std::atomic<int> answers{0}, refusals{0};
  for (std::size_t i = 0; i < FaultService::max_waiting + 3; ++i) {
    service.request({.name = "silent", .on = true}, [&](const ApiAnswer& made) {
      ++answers;
      if (made.status == 503) ++refusals;
    });
  }
  EXPECT_EQ(answers, 3) << "nobody has begun: the queue is full";
  service.close();
  EXPECT_EQ(answers, static_cast<int>(FaultService::max_waiting) + 3);
  EXPECT_EQ(refusals, answers);
}

// The caller is not held up: only the service waits.
TEST_F(FaultServiceTest, OneThatNeverAnswersDoesNotHoldUpTheRequest) {
  auto deaf = CommandSocket::open(at());
  ASSERT_TRUE(deaf);
  start();
  const TimeNs before = monotonic_ns();
  std::atomic<bool> answered{false};
  service.request({.name = "silent", .on = true}, [&](const ApiAnswer& made) {
    EXPECT_EQ(made.status, 503U);
    answered = true;
  });
  EXPECT_LT(monotonic_ns() - before, ns_per_s);
  wait([&] { return answered.load(); });
}

}  // namespace
}  // namespace ledgerline::ground::service
