#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

#include "hil/fault/random_script.hpp"
#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"
#include "hil/fault/shrink.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;

TEST(RandomFaultCampaign, NoInvariantBreaks) {
  const std::size_t count = static_cast<std::size_t>(seeds(slow ? 1 : 100, 10'000));
  double flown_s = 0;
  const TimeNs begin = monotonic_ns();
  fly_all(
      count, 2,
      [](std::size_t i) {
        return Flight{draw_script(i + 1), i + 1};
      },
      [&](std::size_t, const Flight& flight, Result<RunResult> result) {
        EXPECT_TRUE(result.ok()) << flight.script.name;
        if (!result) return true;
        flown_s += to_seconds(result->flown_ns);
        EXPECT_TRUE(result->all_held()) << text_of(flight.script) << broken_text(*result);
        return true;
      });
  std::printf("%zu random flights, %.0f s flown, %.0f times real time in two threads\n", count, flown_s,
              flown_s / to_seconds(monotonic_ns() - begin));
}

TEST(FaultRandom, DrawsEveryKindOfFaultAndOfDistribution) {
  const fs::path recording = fs::temp_directory_path() / ("delays-" + std::to_string(::getpid()));
  std::ofstream(recording) << "0.02\n0.5\n0.03\n";
  std::string drawn;
  for (std::uint64_t number = 1; number <= 500; ++number) {
    const Script script = draw_script(number, recording);
    for (const Fault& fault : script.faults) drawn += fault.text + "\n";
  }
  for (const char* wanted :
       {"ledger restart",  "ledger stall", " rate ",      "normal ",      "gamma ",      "uniform ",     " plans ",
        "lies hash",       "errs twice",   "reboot",      "corrupt ",     "clock jump",  "host suspend", "wind ",
        "answers shifted", "answers late", "states torn", "states other", "imu invalid", "heat 10"})
    EXPECT_NE(drawn.find(wanted), std::string::npos) << wanted;
  EXPECT_NE(drawn.find("delay recorded " + recording.string()), std::string::npos);
  EXPECT_NE(drawn.find("jitter recorded " + recording.string()), std::string::npos);
  fs::remove(recording);
}

TEST(FaultRandom, DrawsEverySenseAndWhatBecomesOfIt) {
  std::string drawn;
  std::size_t by_mocap = 0, by_both = 0, by_own = 0, by_pads = 0, turned = 0, drawn_tello = 0;
  for (std::uint64_t number = 1; number <= 600; ++number) {
    const Script script = draw_script(number);
    const link::PoseSource pose = script.flight.pose;
    ++(pose == link::PoseSource::mocap              ? by_mocap
       : pose == link::PoseSource::mocap_then_tello ? by_both
       : pose == link::PoseSource::pads             ? by_pads
                                                    : by_own);
    if (script.flight.yaw_deg != 0) ++turned;
    if (script.flight.drawn_tello) ++drawn_tello;
    EXPECT_EQ(script.flight.pads.size(), pose == link::PoseSource::pads ? 4U : 0U) << script.name;
    for (const Fault& fault : script.faults) {
      drawn += fault.text + "\n";
      if (!link::uses_mocap(pose)) {
        EXPECT_FALSE(fault.text.starts_with("mocap ")) << script.name;
      }
    }
    const std::string text = text_of(script);
    const auto read = parse_script(text, script.name + ".toml");
    ASSERT_TRUE(read.ok()) << read.error().message << text;
    EXPECT_EQ(text_of(*read), text);  // the shortest scripts of what breaks are kept as text
  }
  EXPECT_NEAR(static_cast<double>(by_own + by_pads) / 600, 1. / 3, 0.08);
  EXPECT_NEAR(static_cast<double>(by_pads) / 600, 1. / 6, 0.06);
  EXPECT_NEAR(static_cast<double>(turned) / 600, 0.5, 0.08);
  EXPECT_NEAR(static_cast<double>(drawn_tello) / 600, 0.5, 0.08);
  EXPECT_NEAR(static_cast<double>(by_both) / 600, 2. / 9, 0.07);
  EXPECT_EQ(by_mocap + by_both + by_own + by_pads, 600U);
  for (const char* wanted : {"flow lost", " light ", " floor ", "flow bias ", "tof nothing", "baro drift 0",
                             "baro drift -", "pads gone", "drone * flow", "drone tello2 "})
    EXPECT_NE(drawn.find(wanted), std::string::npos) << wanted;
}

TEST(FaultRandom, AFailingScriptIsShrunkToWhatMakesItFail) {
  Script script = draw_script(4);
  script.flight.laps = 8;
  const auto add = [&](const char* what, const char* at, const char* lasts) {
    auto fault = parse_fault(what, at, lasts);
    ASSERT_TRUE(fault.ok()) << fault.error().message;
    script.faults.push_back(*fault);
  };
  add("mocap tello1 frozen", "path + 1600ms", "800ms");
  // The "failure": a frozen mocap of at least 100 ms, whatever else.
  const auto fails = [](const Script& tried) {
    return std::any_of(tried.faults.begin(), tried.faults.end(), [](const Fault& fault) {
      return fault.text == "mocap tello1 frozen" && fault.for_ns >= 100 * ns_per_ms;
    });
  };
  const Script shortest = shrink(script, fails);
  ASSERT_EQ(shortest.faults.size(), 1U);
  EXPECT_EQ(shortest.faults[0].text, "mocap tello1 frozen");
  EXPECT_EQ(shortest.faults[0].for_ns, 100 * ns_per_ms);
  EXPECT_EQ(shortest.faults[0].at, "path");
  EXPECT_EQ(shortest.flight.laps, 1);
  EXPECT_TRUE(parse_script(text_of(shortest), "x.toml").ok());
}

}  // namespace
}  // namespace ledgerline::hil
