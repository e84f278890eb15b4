#include <gmock/gmock.h>

#include "tools/control/table.hpp"

namespace ledgerline::control {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Identity identity(const std::string& msp_id, const std::string& subject) {
  Identity one;
  one.set_msp_id(msp_id);
  one.set_subject(subject);
  return one;
}

Control record() {
  Control control;
  control.set_drone("tello1");
  control.set_epoch(4);
  *control.mutable_owner() = identity("Org1MSP", "CN=host");
  return control;
}

TEST(ControlTable, ADroneThatNobodyHoldsSaysSo) {
  EXPECT_EQ(control_table({record()}), "tello1\n  host     Org1MSP CN=host\n  holder   nobody, epoch 4\n");
}

TEST(ControlTable, EverythingThatTheRecordSaysIsThere) {
  Control control = record();
  *control.mutable_holder() = identity("Org2MSP", "CN=pilot");
  *control.mutable_delegate() = identity("Org2MSP", "CN=station");
  control.set_priority(7);
  *control.add_revoked() = control.holder();
  Stop& stop = *control.add_stoppers();
  *stop.mutable_stopper() = identity("Org1MSP", "CN=guard");
  Stop& cut = *control.add_stoppers();
  *cut.mutable_stopper() = identity("Org1MSP", "CN=chief");
  cut.set_cut(true);
  Request& request = *control.add_requests();
  *request.mutable_who() = identity("Org2MSP", "CN=rival");
  request.set_priority(3);
  Request& second = *control.add_requests();
  *second.mutable_who() = identity("Org2MSP", "CN=second");
  *second.mutable_delegate() = control.delegate();
  Grant& grant = *control.add_grants();
  *grant.mutable_to() = identity("Org2MSP", "");
  grant.set_fly(true);
  grant.set_max_priority(9);
  grant.set_cut(true);
  EXPECT_EQ(control_table({control}),
            "tello1\n"
            "  host     Org1MSP CN=host\n"
            "  holder   Org2MSP CN=pilot, priority 7, epoch 4\n"
            "  commands Org2MSP CN=station\n"
            "  revoked  Org2MSP CN=pilot\n"
            "  stopped  Org1MSP CN=guard\n"
            "  cut by   Org1MSP CN=chief\n"
            "  requests Org2MSP CN=rival, priority 3\n"
            "  requests Org2MSP CN=second, priority 0, for Org2MSP CN=station to command\n"
            "  granted  Org2MSP (its operators and supervisors): fly up to priority 9, cut\n");
}

TEST(ControlTable, WhatSomebodyWroteIntoANameStaysOnItsLine) {
  Control control = record();
  *control.mutable_holder() = identity("Org2MSP", "CN=a\n  holder   Org1MSP\x1b[2J");
  EXPECT_THAT(control_table({control}), Not(HasSubstr("\x1b")));
  EXPECT_THAT(control_table({control}), Not(HasSubstr("\n  holder   Org1MSP")));
}

}  // namespace
}  // namespace ledgerline::control
