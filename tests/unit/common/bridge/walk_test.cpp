#include <gtest/gtest.h>

#include <deque>
#include <numeric>

#include "common/base/random.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/common/bridge/world.hpp"

namespace ledgerline::bridge {
namespace {

using namespace testing;
using Kind = fabric::Outcome::Kind;

/// An uplink, a ledger that fails at random, and a downlink.
class Walk {
 public:
  explicit Walk(std::uint64_t seed) : random_(seed) {
    Rule joy = rule("/joy", 9, 50), image = rule("/image", 1, 4), chatter = rule("/chatter", 5, 20),
         odom = rule("/tello1/odom");
    odom.stream = true;
    const std::vector<Rule> rules{joy, image, chatter, odom};
    UplinkConfig config = uplink_config(rules);
    config.seed = seed;
    uplink_.emplace(config);
    downlink_.emplace(DownlinkConfig{.rules = rules, .self = org2, .writer = writer_of(org2, "")}, *registry_);
    for (const Rule& r : rules) topics_.push_back(*uplink_->open(r.name, "p/msg/A"));
    newest_.resize(topics_.size());
  }

  /// How many messages came through.
  std::uint64_t run() {
    for (int turn = 0; turn < 400; ++turn) step(turn < 300);
    while (uplink_->has_waiting() || uplink_->calls_in_flight() > 0) step(false);
    for (const std::size_t topic : topics_) {
      const UplinkCounters& up = uplink_->topics()[topic].counters;
      const auto lost = std::accumulate(up.drops.begin(), up.drops.end(), std::uint64_t{0});
      EXPECT_EQ(up.pending, 0U);
      EXPECT_EQ(up.taken, up.on_ledger + lost);
      // A call whose fate was not known may be on the ledger though it counts as dropped; and what was sent again
      // behind a newer one that had come through after all is out of order, which readers see as a gap.
      const std::string& name = uplink_->topics()[topic].name;
      std::uint64_t missing = 0;
      for (const auto& down : downlink_->topics()) missing += down.name == name ? down.counters.missing : 0;
      EXPECT_LE(published_[name], up.taken);
      EXPECT_GE(published_[name] + lost + missing, up.taken);
      carried_ += published_[name];
    }
    return carried_;
  }

 private:
  struct InFlight {
    Uplink::Submit submit;
    TimeNs until_ns;
    Kind kind;
    bool ordered;
  };

  void step(bool adding) {
    now_ += static_cast<TimeNs>(random_.next() % (20 * ns_per_ms));
    for (std::size_t i = 0; adding && i < topics_.size(); ++i) {
      for (auto n = random_.next() % 4; n > 0; --n) {
        std::string text = cdr(std::to_string(++newest_[i]));
        if (i == 1) text.resize(20'000 + random_.next() % 100'000);
        uplink_->add(now_, topics_[i], now_, bytes(text));
      }
    }
    while (auto call = uplink_->next(now_)) {
      const auto draw = random_.next() % 10;
      // Of those that do not come back some are on the ledger all the same.
      in_flight_.push_back({.submit = std::move(*call),
                            .until_ns = now_ + static_cast<TimeNs>(random_.next() % (200 * ns_per_ms)),
                            .kind = draw < 7    ? Kind::committed
                                    : draw == 7 ? Kind::invalidated
                                                : Kind::unavailable,
                            .ordered = draw < 7 || draw == 8});
      if (in_flight_.back().ordered) order(in_flight_.back().submit);
    }
    for (auto it = in_flight_.begin(); it != in_flight_.end();) {
      if (it->until_ns > now_) {
        ++it;
        continue;
      }
      uplink_->finished(now_, it->submit.number, ended(it->kind));
      it = in_flight_.erase(it);
    }
  }

  void order(const Uplink::Submit& submit) {
    LedgerOfTests::Tx tx;
    tx.creator = org1;
    tx.event_name = "set";
    tx.event_payload = submit.call.args[0];
    const fabric::Block block = ledger_.block({tx});
    std::vector<Downlink::Delivery> out;
    downlink_->on_block(now_, block, out);
    for (const auto& one : out) {
      const std::string& name = downlink_->topics()[one.topic].name;
      const std::uint64_t number = std::stoull(std::string(one.cdr.begin() + 4, one.cdr.end()));
      EXPECT_GT(number, last_[name]) << name;
      last_[name] = number;
      ++published_[name];
    }
  }

  Random random_;
  std::unique_ptr<crypto::MspRegistry> registry_ = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
  LedgerOfTests ledger_;
  std::optional<Uplink> uplink_;
  std::optional<Downlink> downlink_;
  std::vector<std::size_t> topics_;
  std::vector<std::uint64_t> newest_;
  std::deque<InFlight> in_flight_;
  std::map<std::string, std::uint64_t> last_, published_;
  TimeNs now_ = 1'000 * ns_per_s;
  std::uint64_t carried_ = 0;
};

TEST(BridgeWalk, NothingIsDoubledOrOutOfOrderHoweverTheLedgerFailsAndWhatIsLostIsCounted) {
  for (int seed = 1; seed <= seeds(50, 5'000); ++seed) {
    EXPECT_GT(Walk(static_cast<std::uint64_t>(seed)).run(), 500U);
    if (::testing::Test::HasFailure()) FAIL() << "seed " << seed;
  }
}

}  // namespace
}  // namespace ledgerline::bridge
