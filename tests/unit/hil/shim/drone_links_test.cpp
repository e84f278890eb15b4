#include "hil/shim/drone_links.hpp"

#include <gtest/gtest.h>

namespace ledgerline::hil::shim {
namespace {

constexpr sim::Endpoint client{1, command_port}, listener{1, state_port};

class DroneLinksTest : public ::testing::Test {
 protected:
  void apply(const std::string& command) {
    const Status applied = switches.apply(command);
    ASSERT_TRUE(applied) << applied.error().message;
    ways.set(switches);
  }
  std::vector<std::string> heard_by_drones(TimeNs now) {
    std::vector<std::string> all;
    while (const auto sent = ways.to_drone(now)) all.push_back(std::to_string(sent->drone) + sent->bytes);
    return all;
  }
  std::vector<std::string> heard_by_client(TimeNs now) {
    std::vector<std::string> all;
    while (const auto said = ways.to_client(now)) {
      EXPECT_EQ(said->to.address, client.address);
      all.push_back(std::to_string(said->drone) + (said->to == listener ? "s:" : "a:") + said->bytes);
    }
    return all;
  }
  using Texts = std::vector<std::string>;
  proxy::Switches switches{DroneLinks::targets(2)};
  DroneLinks ways{2, 1};
};

TEST_F(DroneLinksTest, WithoutFaultsEverythingGoesThroughAtOnce) {
  ways.from_client(0, 2, client, "command");
  ways.from_client(0, 7, client, "of nobody");
  EXPECT_EQ(heard_by_drones(0), Texts{"2command"});
  ways.from_drone(0, {2, client, "ok"});
  ways.from_drone(0, {1, listener, "bat:90;"});
  EXPECT_EQ(heard_by_client(0), (Texts{"1s:bat:90;", "2a:ok"}));
  EXPECT_FALSE(ways.next_due());
}

TEST_F(DroneLinksTest, EachWayIsImpairedByItself) {
  apply("drone tello1 answers delay 200ms");
  ways.from_client(0, 1, client, "command");
  EXPECT_EQ(heard_by_drones(0), Texts{"1command"});
  ways.from_drone(0, {1, client, "ok"});
  ways.from_drone(0, {1, listener, "bat:90;"});
  EXPECT_EQ(heard_by_client(0), Texts{"1s:bat:90;"});
  EXPECT_EQ(ways.next_due(), 200 * ns_per_ms);
  EXPECT_EQ(heard_by_client(200 * ns_per_ms), Texts{"1a:ok"});
}

TEST(LinkRecording, IsPlayedBehindTheShimAsByTheProxy) {
  const auto day = [](const std::string& path) { return parse_link_recording(path, "0,0.2\n1,lost\n2,0.1\n"); };
  proxy::Switches switches(DroneLinks::targets(1), reading_once<Distribution::Recording>(read_recording),
                           reading_once<std::shared_ptr<const LinkRecording>>(day));
  const Status applied = switches.apply("drone tello1 state recorded-day f");
  ASSERT_TRUE(applied) << applied.error().message;
  DroneLinks ways(1, 1);
  ways.set(switches);
  const auto came = [&](TimeNs now) {
    ways.from_drone(now, {1, listener, "h:1;"});
    (void)ways.to_client(now);  // which takes what is due from the drone into its link
    const auto due = ways.next_due();
    if (due) (void)ways.to_client(*due);
    return due;
  };
  EXPECT_EQ(came(0), 200 * ns_per_ms);
  EXPECT_EQ(came(1'500 * ns_per_ms), std::nullopt);
  EXPECT_EQ(came(2'000 * ns_per_ms), 2'100 * ns_per_ms);
}

TEST_F(DroneLinksTest, KnowsTheSdksCalls) {
  apply("sdk tello1 answers wrong to takeoff");
  apply("sdk tello2 states other");
  for (const DroneNumber drone : {DroneNumber{1}, DroneNumber{2}}) {
    for (const char* command : {"command", "takeoff"}) {
      ways.from_client(0, drone, client, command);
      (void)heard_by_drones(0);
      ways.from_drone(0, {drone, client, "ok"});
    }
  }
  EXPECT_EQ(heard_by_client(0), (Texts{"1a:ok", "1a:error", "2a:ok", "2a:ok"}));
  ways.from_drone(0, {1, listener, "h:1;"});
  ways.from_drone(0, {2, listener, "h:2;"});
  EXPECT_EQ(heard_by_client(0), (Texts{"1s:h:1;", "2s:h:1;"}));
  apply("sdk tello1 answers wrong to takeoff off");
  apply("clear");
  ways.from_drone(0, {2, listener, "h:2;"});
  EXPECT_EQ(heard_by_client(0), Texts{"2s:h:2;"});
}

TEST_F(DroneLinksTest, TheSwitchesSayWhatIsWrong) {
  const auto why = [&](const std::string& command) {
    const Status applied = switches.apply(command);
    return applied ? std::string("nothing") : applied.error().message;
  };
  EXPECT_NE(why("server agent cut").find("no such server"), std::string::npos);
  EXPECT_NE(why("sdk tello3 answers missing").find("no such drone"), std::string::npos);
  EXPECT_NE(why("sdk tello1 answers never").find("must be"), std::string::npos);
  EXPECT_NE(why("drone tello1 video loss 5%").find("no video"), std::string::npos);
  proxy::Switches of_one(DroneLinks::targets(1));
  EXPECT_FALSE(of_one.apply("sdk tello1 states other")) << "there is no other drone";
  proxy::Switches of_proxy({{proxy::Target::Kind::drone, "tello1"}});
  const Status refused = of_proxy.apply("sdk tello1 answers missing");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("only the shim"), std::string::npos);
}

}  // namespace
}  // namespace ledgerline::hil::shim
