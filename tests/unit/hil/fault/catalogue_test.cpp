#include "hil/fault/kinds/fault.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hil/fault/real/real_script.hpp"

namespace ledgerline::hil {
namespace {

using testing::HasSubstr;

// Every kind, every choice of its words, every mode: it acts, or it is refused by name. Nothing is taken and then not
// done.

std::string script_of(const std::string& fault, bool momentary) {
  return "title = \"t\"\n[flight]\npads = \"1:0:0\"\nblocks = \"ordered\"\n[[fault]]\nwhat = \"" + fault + "\"\n" +
         (momentary ? "" : "for = \"1s\"\n");
}

bool acts_in_sitl(const FaultActs& acts) { return acts.strike || acts.begin || acts.lasts || acts.lasts_on; }

bool is_nothing(const RealActs& acts) {
  return acts.proxy.empty() && acts.programs.empty() && acts.parts.empty() && acts.control.empty() &&
         acts.burn_core < 0 && acts.take_bytes == 0 && !acts.fill_disk;
}

TEST(KindModes, EachKindHasAnExample) {
  for (const FaultKind* kind : fault_kinds())
    EXPECT_FALSE(examples_of(*kind).empty())
        << kind->form << ": catalogue.cpp says what stands for its words in capitals";
  const auto examples = examples_of(**kind_of("agent kill", false));
  EXPECT_THAT(examples, testing::ElementsAre("agent kill", "link kill", "ground kill"));
}

TEST(KindModes, InSimulatedTimeEachFaultActsOrIsRefusedByName) {
  for (const FaultKind* kind : fault_kinds()) {
    for (const std::string& example : examples_of(*kind)) {
      const auto fault = parse_fault(example, "", "", false);
      if (fault) {
        EXPECT_TRUE(acts_in_sitl(fault->acts)) << example << " is taken and does nothing";
        continue;
      }
      const auto script = check_script(script_of(example, true), "x.toml");
      ASSERT_FALSE(script.ok()) << example;
      EXPECT_THAT(script.error().message, HasSubstr("x.toml:6: fault.0.what: \"" + example + "\"")) << example;
    }
  }
}

TEST(KindModes, WithTheRealProcessesEachFaultActsOrIsRefusedByName) {
  for (const RealStack stack : {RealStack{}, RealStack{.fabric = true}, RealStack{.shim = true}}) {
    for (const FaultKind* kind : fault_kinds()) {
      for (const std::string& example : examples_of(*kind)) {
        auto fault = parse_fault(example, "", "", true);
        const bool momentary = !fault || fault->acts.momentary;
        if (fault && !momentary) fault = parse_fault(example, "", "1s", true);
        const std::string flight =
            "title = \"t\"\n[[fault]]\nwhat = \"" + example + "\"\n" + (momentary ? "" : "for = \"1s\"\n");
        const auto script = check_script(flight, "x.toml", stack);
        const auto modes = modes_of(*kind);
        const auto& possible = (stack.fabric ? modes.fabric : stack.shim ? modes.shim : modes.embedded).possible;
        const bool is_possible = std::find(possible.begin(), possible.end(), example) != possible.end();
        if (is_possible && script) {
          EXPECT_FALSE(is_nothing(acts_at_begin(*fault, {*fault}, 1, stack)))
              << example << " is taken and does nothing";
          continue;
        }
        ASSERT_FALSE(script.ok()) << example << " is refused by its kind and taken in a script";
        EXPECT_THAT(script.error().message, HasSubstr("x.toml:3: fault.0.what: \"" + example + "\"")) << example;
      }
    }
  }
}

TEST(KindModes, WhatTheFlightHasNotIsRefusedByName) {
  const auto error_of = [](const std::string& flight, const std::string& fault) {
    const auto script =
        check_script("title = \"t\"\n[flight]\n" + flight + "\n[[fault]]\nwhat = \"" + fault + "\"\n", "x.toml");
    return script ? "" : script.error().message;
  };
  for (const char* fault : {"mocap tello1 frozen", "mocap * jump 1 0 0", "mocap * turn 90", "mocap * noise 0.1",
                            "mocap tello1 every 100ms", "mocap tello1 loss 50%"}) {
    EXPECT_THAT(error_of("pose = \"tello\"", fault),
                HasSubstr(std::string("x.toml:5: fault.0.what: \"") + fault + "\" does nothing"));
    EXPECT_EQ(error_of("pose = \"mocap+tello\"", fault), "") << fault;
  }
  EXPECT_THAT(error_of("laps = 1", "pads gone"), HasSubstr("\"pads gone\" does nothing: there are none"));
  EXPECT_EQ(error_of("pads = \"1:0:0\"", "pads gone"), "");
  EXPECT_THAT(error_of("laps = 1", "ledger both orders forks"), HasSubstr("nobody reads blocks as they are ordered"));
  EXPECT_EQ(error_of("blocks = \"ordered\"", "ledger both orders forks"), "");
}

TEST(KindModes, AreShownInWords) {
  const auto words = [](const char* text, bool real = false) { return modes_text(modes_of(**kind_of(text, real))); };
  EXPECT_EQ(words("drone tello1 to delay 1ms"), "sitl, real");
  EXPECT_EQ(words("drone tello1 reboot"), "sitl");
  EXPECT_EQ(words("agent kill"), "sitl, real: `agent kill`, `link kill`");
  EXPECT_EQ(words("peer 1 kill", true), "real on Fabric");
  EXPECT_EQ(words("disk full", true), "real on the embedded node");
  EXPECT_EQ(words("roudi kill", true), "real");
  EXPECT_THAT(words("ledger agent loss 5%"), HasSubstr("refused: "));
}

}  // namespace
}  // namespace ledgerline::hil
