#include "hil/fault/real/real_script.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hil/fault/run/run.hpp"
#include "hil/fault/scenarios.hpp"

namespace ledgerline::hil {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr const char* text = R"(title = "t"
must = [
  "finishes",
  "sends no takeoff",
]

[flight]
battery = 0.5

[[fault]]
what = "ledger stall"
for = "1s"

[[fault]]
what = "drone tello1 reboot"

[[fault]]
what = "agent kill"
for = "3s"
)";

TEST(Check, OfARealFlightSaysTheLineOfWhatItCannotHave) {
  EXPECT_TRUE(check_script(text, "x.toml").ok());
  const auto script = check_script(text, "x.toml", RealStack{});
  ASSERT_FALSE(script.ok());
  const std::string& error = script.error().message;
  for (const char* wanted : {"x.toml:2: must: \"sends no takeoff\": the traces do not tell it",
                             "x.toml:8: flight.battery: ./fly flies with full",
                             "x.toml:15: fault.1.what: \"drone tello1 reboot\": it is inside of the simulation",
                             "x.toml:18: fault.2.what: \"agent kill\": the launcher starts it again at once"})
    EXPECT_THAT(error, HasSubstr(wanted));
  EXPECT_THAT(error, Not(HasSubstr("ledger stall")));
  EXPECT_THAT(error, Not(HasSubstr("unknown")));
}

TEST(Check, AnswersForTheLedgerThatIsMeant) {
  const std::string flight = "title = \"t\"\n[[fault]]\nwhat = \"peer 1 kill\"\n";
  EXPECT_TRUE(check_script(flight, "x.toml", RealStack{.fabric = true}).ok());
  EXPECT_THAT(check_script(flight, "x.toml", RealStack{}).error().message,
              HasSubstr("x.toml:3: fault.0.what: \"peer 1 kill\": it is a part of Fabric"));
  EXPECT_THAT(check_script(flight, "x.toml").error().message, HasSubstr("needs the real processes"));
}

TEST(Check, OfWhatSomebodysOwnProgramFliesIsForRealTimeWithoutAsking) {
  const std::string sdk = "title = \"t\"\nmust = [\"finishes\", \"hold is seen\"]\n[flight]\nkind = \"sdk\"\n";
  for (const auto& real : {std::optional<RealStack>(), std::optional(RealStack{})}) {
    EXPECT_THAT(check_script(sdk, "x.toml", real).error().message,
                HasSubstr("x.toml:2: must: \"hold is seen\": link says that, and there is none"));
    EXPECT_THAT(check_script(sdk + "predict = false\n", "x.toml", real).error().message,
                HasSubstr("x.toml:5: flight.predict: it is ground's"));
  }
  const std::string plain = "title = \"t\"\n[flight]\nkind = \"sdk\"\n";
  EXPECT_TRUE(check_script(plain, "x.toml", RealStack{}).ok());
  EXPECT_THAT(check_script(plain, "x.toml", RealStack{.shim = true}).error().message,
              HasSubstr("x.toml:3: flight.kind: an SDK client speaks UDP"));
  const std::string manual = "title = \"t\"\n[flight]\nkind = \"manual\"\n";
  EXPECT_TRUE(check_script(manual, "x.toml").ok());
  EXPECT_TRUE(check_script(manual, "x.toml", RealStack{}).ok());
}

TEST(FirstScript, IsFineInEveryModeAndHolds) {
  const std::string first = first_script("mine");
  for (const auto& real : {std::optional<RealStack>(), std::optional(RealStack{}), std::optional(RealStack{true})}) {
    const auto script = check_script(first, "mine.toml", real);
    ASSERT_TRUE(script.ok()) << script.error().message;
    EXPECT_THAT(script->title, HasSubstr("mine"));
  }
  const auto result = run_script(*check_script(first, "mine.toml"), 1);
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_TRUE(result->all_held());
  EXPECT_GT(result->flown_ns, 10 * ns_per_s);
}

}  // namespace
}  // namespace ledgerline::hil
