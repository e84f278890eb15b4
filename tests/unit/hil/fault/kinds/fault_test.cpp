#include "hil/fault/kinds/fault.hpp"

#include <gtest/gtest.h>

#include <set>

#include "common/base/file.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil {
namespace {

/// What stands between ` and ` in a page.
std::vector<std::string> quoted_in(const std::string& page) {
  std::vector<std::string> texts;
  for (std::size_t at = 0; (at = page.find('`', at)) != std::string::npos;) {
    const std::size_t end = page.find('`', at + 1);
    if (end == std::string::npos) break;
    texts.push_back(page.substr(at + 1, end - at - 1));
    std::erase(texts.back(), '\\');  // of a | in a table
    at = end + 1;
  }
  return texts;
}

TEST(FaultKinds, EachHasItsFormInThePage) {
  const auto page = read_file(SOURCES "/docs/faults.md");
  ASSERT_TRUE(page.ok());
  const auto quoted = quoted_in(*page);
  const std::set<std::string> texts(quoted.begin(), quoted.end());
  for (const FaultKind* kind : fault_kinds()) EXPECT_TRUE(texts.contains(std::string(kind->form))) << kind->form;
}

TEST(FaultKinds, AFormThatIsFollowedIsTaken) {
  for (const char* text : {"drone tello1 to delay 200ms, loss 5%",
                           "drone * plans stall",
                           "drone tello1 reboot",
                           "drone tello1 battery 7%",
                           "sensor tello1 h stuck",
                           "sdk * answers late 300ms 30% to takeoff",
                           "sdk tello1 answers shifted",
                           "sdk tello1 states torn 30%",
                           "mocap tello1 jump 1 0 0",
                           "mocap tello1 loss 5%",
                           "wind 1 0 0",
                           "drone * flow lost",
                           "drone tello1 light 10%",
                           "drone tello1 floor 0%",
                           "drone * flow bias 0.1 -0.1",
                           "drone tello1 tof nothing",
                           "drone tello1 baro drift -0.05",
                           "pads gone",
                           "ledger stall",
                           "ledger both cut",
                           "ledger agent to delay uniform 1ms 2ms",
                           "ledger agent lies hash",
                           "ledger relay plan-speed compared",
                           "operator errs boot",
                           "supervisor clear_stop tello1",
                           "agent kill",
                           "link end",
                           "host suspend",
                           "clock jump -5s"}) {
    EXPECT_TRUE(parse_fault(text, "path", "").ok()) << text;
  }
}

TEST(FaultKinds, TheNearestIsSuggested) {
  const auto error = [](const char* text) { return parse_fault(text, "path", "").error().message; };
  EXPECT_EQ(error("drone tello1 kick 1 2"), "\"drone tello1 kick 1 2\": must be `drone NAME kick X Y Z`");
  EXPECT_NE(error("drone tello1 sideways").find("`drone NAME reboot`"), std::string::npos);
  EXPECT_NE(error("ledger agent loss 5%").find("is a stream (TCP) and has no loss"), std::string::npos);
  EXPECT_NE(error("ledger agent lies twice").find("followed by one of chain"), std::string::npos);
  EXPECT_NE(error("drone * light 20%").find("flow is not lost"), std::string::npos);
  EXPECT_NE(error("drone * floor bright").find("floor must be followed by"), std::string::npos);
  EXPECT_NE(error("drone * flow bias 0 0").find("does nothing"), std::string::npos);
  EXPECT_NE(error("drone * flow bias 9 0").find("two velocities"), std::string::npos);
  EXPECT_NE(error("drone * baro drift 0").find("rate in m/s"), std::string::npos);
  EXPECT_NE(error("sdk tello1 answers late").find("TIME of more than nothing"), std::string::npos);
  EXPECT_NE(error("sdk tello1 answers missing to rc").find("has no answer"), std::string::npos);
  EXPECT_NE(error("sdk tello1 states late 1s").find("states torn|stale|other"), std::string::npos);
  const std::string first =
      "must begin with drone, sensor, mocap, wind, sdk, pads, ledger, operator, supervisor, outsider, administrator, "
      "agent, "
      "link, ground, clock, host";
  EXPECT_EQ(error("clouds"), "\"clouds\": " + first);
  EXPECT_EQ(error("hots suspend"), "\"hots suspend\": " + first + ": did you mean host?");
  EXPECT_NE(error("peer 1 kill").find("peer is not there in simulated time"), std::string::npos);
}

TEST(FaultKinds, SaysWhatACheckerMayExpect) {
  const auto acts = [](const char* text) { return parse_fault(text, "path", "")->acts; };
  EXPECT_TRUE(acts("drone tello1 to loss 5%").deafens);
  EXPECT_FALSE(acts("drone tello1 answers loss 5%").deafens);
  EXPECT_TRUE(acts("operator cut tello1").pushes);
  EXPECT_FALSE(acts("operator stop tello1").pushes);
  EXPECT_FALSE(acts("drone tello1 flow lost").pushes) << "how fast it gets is a matter of who steers it";
  EXPECT_TRUE(acts("drone tello1 flow lost").blinds);
  EXPECT_FALSE(acts("drone tello1 tof nothing").pushes);
  EXPECT_TRUE(acts("link kill").stops_link);
  EXPECT_FALSE(acts("agent kill").stops_link);
  EXPECT_TRUE(acts("drone tello1 propeller").breaks);
  EXPECT_TRUE(acts("outsider stop tello1").needs_supervisors);
  EXPECT_DOUBLE_EQ(acts("mocap tello1 jump 3 4 0").misleads_m, 5);
  EXPECT_TRUE(acts("drone tello1 reboot").momentary);
}

}  // namespace
}  // namespace ledgerline::hil
