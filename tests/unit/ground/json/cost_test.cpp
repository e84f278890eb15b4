#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "ground/json/strict.hpp"
#include "ground/mission/mission.hpp"
#include "ground/mission/run.hpp"
#include "ground/motion/waypoints.hpp"
#include "ground/service/core/stream_messages.hpp"

namespace {
std::uint64_t steps = 0;
}

/// The compiler has it called at each basic block of the reader (-fsanitize-coverage=trace-pc).
extern "C" __attribute__((no_sanitize_coverage)) void __sanitizer_cov_trace_pc() { ++steps; }

/// A sender must not make its bytes expensive: the cost of reading them is bounded by their number.
namespace ledgerline::ground {
namespace {

using testing::HasSubstr;

// A byte costs some dozens; a reader that goes through a list once for each of its values needs thousands at these
// lengths.
constexpr std::uint64_t max_steps_a_byte = 200, max_steps_beside = 20'000;

struct Reader {
  const char* name;
  std::function<bool(const std::string& text)> is_taken;
  std::size_t max_bytes;
};

const std::vector<std::string> names{"tello1"};
const std::deque<service::Event> events;
const std::vector<service::Operator> operators;
const service::ApiContext known{names, "[]", "{}", events, operators};

std::vector<Reader> readers() {
  return {{"request",
           [](const std::string& text) {
             return service::answer({"POST", "/api/v1/drones/tello1/path", text}, known).status < 300;
           },
           service::max_body_bytes},
          {"message", [](const std::string& text) { return read_stream_message(text, {}, known, 1).ok(); }, 4096},
          {"mission", [](const std::string& text) { return mission::mission_from_json(text).ok(); },
           mission::max_mission_bytes},
          {"kept", [](const std::string& text) { return mission::MissionRun::restore(text, {}).ok(); },
           mission::max_mission_bytes},
          {"faults", [](const std::string& text) { return service::faults_from(text).ok(); }, 1'000'000}};
}

std::uint64_t steps_of(const Reader& reader, const std::string& text) {
  const std::uint64_t before = steps;
  (void)reader.is_taken(text);
  return steps - before;
}

/// `unit` again and again, as many as make `bytes`; %d in it: another number each time.
std::string repeated(const std::string& before, const std::string& unit, const std::string& after, std::size_t bytes) {
  std::string text = before;
  for (int i = 0; text.size() + unit.size() + after.size() + 8 < bytes; ++i) {
    std::string one = unit;
    if (const auto at = one.find("%d"); at != std::string::npos) one.replace(at, 2, std::to_string(i));
    text += one;
  }
  if (text.back() == ',') text.pop_back();
  return text + after;
}

TEST(CostOfReading, IsBoundedByTheBytesWhateverTheySay) {
  const std::vector<std::pair<std::string, std::string>> around{
      {R"({"waypoints":[)", "]}"},
      {R"({"drones":[)", "]}"},
      {R"({"drones":[{"drone":"tello1","waypoints":[)", "]}]}"},
      {"[", "]"},
      {R"({"faults":[)", "]}"},
      {"{", "}"},
      {R"({"a":{)", "}}"},
      {R"({"a":[[)", "]]}"}};
  const std::vector<std::string> units{
      "{},",         "[],",        "1,",        R"({"x":1},)", R"({"x":1,"y":2,"z":1,"speed":1},)",
      R"("%d":{},)", R"("%d":1,)", R"("a":1,)", R"("",)",      "1e999,",
      "[{}],",       "[",          "{\"a\":",   "\\u0000"};
  for (const Reader& reader : readers()) {
    for (const auto& [before, after] : around) {
      for (const std::string& unit : units) {
        const std::size_t bytes = std::min<std::size_t>(reader.max_bytes, 100'000);
        const std::string text = repeated(before, unit, after, bytes);
        EXPECT_LE(steps_of(reader, text), max_steps_a_byte * text.size() + max_steps_beside)
            << reader.name << ": " << before << unit << "..." << after;
      }
    }
  }
}

TEST(CostOfReading, OfDrawnTextsIsBoundedToo) {
  const std::vector<std::string> parts{"{", "}",      "[",    "]",    ",",  ":",  "\"a\"",     "\"%\"",
                                       "1", "-0.5e3", "null", "true", "{}", "[]", "{\"x\":1}", "\"\\u00e9\""};
  const auto all = readers();
  for (unsigned seed = 1; seed <= 200; ++seed) {
    std::mt19937 draw(seed);
    const auto random = [&] { return static_cast<unsigned>(draw()); };
    const Reader& reader = all[random() % all.size()];
    // Long runs of a few parts: what costs more than its bytes is a repetition.
    std::string text = "{\"drones\":[";
    while (text.size() < 20'000) {
      std::string run;
      for (unsigned k = random() % 4 + 1; k > 0; --k) run += parts[random() % parts.size()];
      for (unsigned k = random() % 500; k > 0; --k) text += run;
    }
    EXPECT_LE(steps_of(reader, text), max_steps_a_byte * text.size() + max_steps_beside)
        << reader.name << ", seed " << seed;
  }
}

TEST(CostOfReading, EndsAtTheFirstValueTooMany) {
  const json::Bounds bounds{1'000'000, 4, 1000};
  const auto text = [](std::size_t bytes) { return repeated(R"({"a":[)", "{},", "]}", bytes); };
  const auto cost = [&](std::size_t bytes) {
    const std::string long_one = text(bytes);
    const std::uint64_t before = steps;
    const auto read = json::object_from(long_one, "the body", bounds);
    EXPECT_FALSE(read);
    EXPECT_THAT(read.error().message, HasSubstr("the body has more than 1000 values"));
    return steps - before;
  };
  EXPECT_EQ(cost(10'000), cost(900'000));
  EXPECT_THAT(json::object_from(text(1'000'100), "the body", bounds).error().message, HasSubstr("1000000 may be"));
  EXPECT_TRUE(json::object_from(text(2'900), "the body", bounds));
}

TEST(CostOfReading, TheLargestMissionAndPathAreWithinTheBounds) {
  std::string waypoints;
  for (std::size_t i = 0; i < motion::max_waypoints; ++i)
    waypoints += fmt::format(R"({}{{"x":{},"y":2,"z":1,"speed":0.5}})", i > 0 ? "," : "", i % 2);
  std::string drones;
  for (std::size_t i = 0; i < mission::max_drones; ++i) {
    drones +=
        fmt::format(R"({}{{"drone":"tello{}","start":{{"x":1,"y":2}},"speed":0.5,"then":"land","waypoints":[{}]}})",
                    i > 0 ? "," : "", i, waypoints);
  }
  const std::string text = fmt::format(R"({{"name":"m","drones":[{}]}})", drones);
  const auto mission = mission::mission_from_json(text);
  ASSERT_TRUE(mission) << mission.error().message;
  const auto run = mission::MissionRun::make(*mission, {});
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_TRUE(mission::MissionRun::restore(run->saved(), {}));
  EXPECT_EQ(
      service::answer({"POST", "/api/v1/drones/tello1/path", fmt::format(R"({{"waypoints":[{}]}})", waypoints)}, known)
          .status,
      202U);
}

TEST(CostOfReading, OfALineOfATableIsThatOfItsColumns) {
  EXPECT_LE(motion::cells_of(std::string(1'000'000, ',')).size(), motion::max_cells + 1);
}

}  // namespace
}  // namespace ledgerline::ground
