#include "chaincode/network/setup/site.hpp"

#include "tests/unit/chaincode/network/setup/fake_tools.hpp"

namespace ledgerline::network {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(SiteTest, AProgramThatIsMissingIsNamed) {
  const FakeTools tools;
  std::filesystem::remove(tools.options().tools + "/osnadmin");
  const Status opened = Site(tools.options()).open();
  ASSERT_FALSE(opened);
  EXPECT_THAT(opened.error().message, HasSubstr("/osnadmin is missing: scripts/fabric-tools builds"));
}

TEST(SiteTest, AStepThatIsDoneIsNotDoneAgainByTheNextStartInTheDirectory) {
  const FakeTools tools;
  int done_steps = 0;
  const auto step = [&]() -> Status {
    ++done_steps;
    return done;
  };
  for (int start = 0; start < 2; ++start) {
    Site site(tools.options());
    ASSERT_TRUE(site.open().ok());
    ASSERT_TRUE(site.once("step", step).ok());
  }
  EXPECT_EQ(done_steps, 1);
}

TEST(SiteTest, AStepThatFailsIsTriedAgainAndNamesNoOtherChannel) {
  const FakeTools tools;
  Options options = tools.options();
  options.channels = {"teleop", "yard"};
  Site site(options);
  ASSERT_TRUE(site.open().ok());
  std::vector<std::string> tried;
  bool broken = true;
  const auto step = [&](const std::string& channel) -> Status {
    tried.push_back(channel);
    if (broken && channel == "yard") return Error{"not yet"};
    return done;
  };
  EXPECT_FALSE(site.once_per_channel("step", step).ok());
  broken = false;
  EXPECT_TRUE(site.once_per_channel("step", step).ok());
  EXPECT_THAT(tried, ElementsAre("teleop", "yard", "yard"));
}

TEST(SiteTest, PlacesStayThoseOfTheFirstStart) {
  const FakeTools tools;
  Site first(tools.options());
  ASSERT_TRUE(first.open().ok());
  Site second(tools.options());
  ASSERT_TRUE(second.open().ok());
  EXPECT_EQ(first.addresses(), second.addresses());
}

}  // namespace
}  // namespace ledgerline::network
