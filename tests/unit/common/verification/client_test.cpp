#include "common/fabric/client/client.hpp"
#include "common/fabric/calls/repeat.hpp"
#include "common/verification/calls.hpp"

#include <gmock/gmock.h>

#include <deque>

namespace ledgerline::verification {
namespace {

using fabric::Outcome;
using ::testing::ElementsAre;
using Kind = Outcome::Kind;

/// Answers each call with the next outcome; nothing but submit_and_wait is asked.
class AnsweringClient final : public fabric::Client {
 public:
  Outcome submit_and_wait(fabric::Call call) override {
    calls.push_back(call.function);
    Outcome outcome = answers.front();
    answers.pop_front();
    return outcome;
  }
  void submit(fabric::Call, std::function<void(Outcome)>) override { ADD_FAILURE(); }
  Result<std::string> evaluate(fabric::Call) override { return not_asked(); }
  Result<std::string> evaluate_at_peer(fabric::Call) override { return not_asked(); }
  Status endorsable(fabric::Call) override { return not_asked(); }
  std::unique_ptr<Stream> blocks(std::optional<std::uint64_t>, StreamHandlers) override { return nullptr; }
  std::unique_ptr<Stream> blocks_behind(fabric::LastVerified, StreamHandlers) override { return nullptr; }
  std::unique_ptr<Stream> events(std::optional<std::uint64_t>, std::function<void(const Event&)>,
                                 std::function<void(bool, const std::string&)>, std::string) override {
    return nullptr;
  }

  std::deque<Outcome> answers;
  std::vector<std::string> calls;

 private:
  static Error not_asked() {
    ADD_FAILURE();
    return Error{"not asked"};
  }
};

Outcome ended(Kind kind) {
  Outcome outcome;
  outcome.kind = kind;
  if (kind == Kind::invalidated) outcome.code = 11;
  if (kind == Kind::refused) outcome.refusal.emplace();
  return outcome;
}

/// The functions that are called for one that loses, then ends as the last of the answers that are its own.
std::vector<std::string> calls_for(const std::string& function, const std::vector<Kind>& answers) {
  AnsweringClient client;
  for (const Kind kind : answers) client.answers.push_back(ended(kind));
  (void)submit_claiming(client, {function, {"tello1"}}, {"tello1"},
                        {.first_pause_ns = 1, .max_pause_ns = 1, .attempts = 2, .conflicts_only = true}, {});
  EXPECT_TRUE(client.answers.empty());
  return client.calls;
}

TEST(SubmitClaiming, OneThatIsOnTheLedgerAtOnceClaimsNothing) {
  EXPECT_THAT(calls_for("release", {Kind::committed}), ElementsAre("release"));
}

TEST(SubmitClaiming, OneThatLostToAnotherClaimsAndEndsTheClaimItself) {
  EXPECT_THAT(calls_for("release", {Kind::invalidated, Kind::committed, Kind::committed}),
              ElementsAre("release", "claim", "release"));
}

TEST(SubmitClaiming, AFunctionThatClaimsAreNotForClaimsNothing) {
  EXPECT_THAT(calls_for("acquire", {Kind::invalidated, Kind::committed}), ElementsAre("acquire", "acquire"));
}

TEST(SubmitClaiming, WhoMayNotClaimGoesOnWithout) {
  EXPECT_THAT(calls_for("evict", {Kind::invalidated, Kind::refused, Kind::invalidated}),
              ElementsAre("evict", "claim", "evict"));
}

TEST(SubmitClaiming, AClaimThatMayStandIsEndedBehindOneThatIsGivenUp) {
  EXPECT_THAT(calls_for("evict", {Kind::invalidated, Kind::committed, Kind::invalidated, Kind::committed}),
              ElementsAre("evict", "claim", "evict", "unclaim"));
  EXPECT_THAT(calls_for("evict", {Kind::invalidated, Kind::unavailable, Kind::refused, Kind::committed}),
              ElementsAre("evict", "claim", "evict", "unclaim"))
      << "a claim without an answer may be on the ledger";
}

}  // namespace
}  // namespace ledgerline::verification
