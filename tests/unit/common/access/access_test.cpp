#include "common/access/access.hpp"

#include <gmock/gmock.h>

#include <fstream>
#include <random>
#include <set>
#include <sstream>

#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "common/msg/contract.hpp"
#include "common/verification/control_events.hpp"

namespace ledgerline::access {
namespace {

using crypto::IdentityName;

const std::vector<Role> given_roles{ROLE_NONE, OPERATOR, SUPERVISOR, AUDITOR, REVOKED};

/// Random records and calls among a few people of two organisations; often such that a rule has something to say.
class Draw {
 public:
  explicit Draw(unsigned seed) : random_(seed) {
    for (const char* msp_id : {"Org1MSP", "Org2MSP"}) {
      for (const char* subject : {"CN=host", "CN=pilot", "CN=chief", "CN=station"})
        people_.push_back({msp_id, subject});
    }
    for (const IdentityName& one : people_) inputs.roles.known[one] = given_roles[number(given_roles.size())];
    inputs.moves_streams = one_of(2);
    caller = {person(), one_of(3)};
    call = draw_call();
    record = draw_record();
    inputs.new_epoch = record.epoch() + 1;
  }

  bool one_of(int n) { return number(static_cast<std::size_t>(n)) == 0; }
  std::size_t number(std::size_t below) { return std::uniform_int_distribution<std::size_t>(0, below - 1)(random_); }
  const IdentityName& person() { return people_[number(people_.size())]; }

  RuleInputs inputs{.roles = {.all = true}};
  Caller caller;
  Call call;
  Control record;
  bool is_host() const { return to_name(record.owner()) == caller.name; }
  Role role() const { return inputs.roles.known.at(caller.name); }

 private:
  template <typename Message>
  Message with_drone() {
    Message message;
    message.add_drones("tello1");
    return message;
  }

  Call draw_call() {
    const std::string function(contract::control_functions[number(contract::control_functions.size())]);
    if (function == contract::enroll) {
      auto enroll = with_drone<EnrollCall>();
      *enroll.mutable_identity() = to_message(person());
      enroll.set_role(given_roles[number(given_roles.size() - 1)]);
      return {function, enroll};
    }
    if (function == contract::revoke) {
      RevokeCall revoke;
      *revoke.mutable_identity() = to_message(person());
      return {function, revoke};
    }
    if (function == contract::grant) {
      auto grant = with_drone<GrantCall>();
      *grant.mutable_grant() = draw_grant();
      return {function, grant};
    }
    if (function == contract::hand_over || function == contract::deny) {
      auto answer = with_drone<AnswerCall>();
      *answer.mutable_to() = to_message(person());
      return {function, answer};
    }
    if (function == contract::acquire || function == contract::release || function == contract::request) {
      auto lease = with_drone<LeaseCall>();
      lease.set_priority(static_cast<std::uint32_t>(number(4)));
      if (function != contract::release && one_of(2)) *lease.mutable_delegate() = to_message(person());
      return {function, lease};
    }
    auto drones = with_drone<DronesCall>();
    drones.set_cut(one_of(2));
    if (function == contract::evict && one_of(2)) drones.add_epochs(number(3));
    if (function == contract::stop && one_of(2)) drones.add_clears(number(2));
    return {function, drones};
  }

  Grant draw_grant() {
    Grant grant;
    *grant.mutable_to() = to_message(person());
    grant.set_fly(one_of(2));
    grant.set_stop(one_of(2));
    grant.set_cut(one_of(2));
    if (grant.fly()) grant.set_max_priority(static_cast<std::uint32_t>(number(3)));
    return grant;
  }

  Control draw_record() {
    Control drawn;
    drawn.set_drone("tello1");
    if (one_of(10)) return drawn;
    *drawn.mutable_owner() = to_message(people_[0]);
    drawn.set_epoch(number(3));
    for (int i = 0; i < 3; ++i) {
      if (Grant grant = draw_grant(); grant.to().msp_id() != "Org1MSP") set_grant(drawn, grant, drawn.epoch());
      if (one_of(2)) add_request(drawn, to_message(person()), nullptr, static_cast<std::uint32_t>(number(3)));
    }
    if (one_of(2)) {  // a request with a delegate
      const IdentityName& who = person();
      const Identity station = to_message({who.msp_id, "CN=station"});
      add_request(drawn, to_message(who), &station, static_cast<std::uint32_t>(number(3)));
    }
    if (one_of(4)) fill(drawn);
    if (one_of(2)) {
      Stop stop;
      stop.set_drone("tello1");
      *stop.mutable_stopper() = to_message(person());
      add_stop(drawn, stop);
    }
    if (!one_of(3)) {
      const IdentityName& holder = person();
      const Identity station = to_message({holder.msp_id, "CN=station"});
      const bool delegates = one_of(2) && may_delegate(to_message(holder), station);
      begin_lease(drawn, to_message(holder), delegates ? &station : nullptr, drawn.epoch(),
                  static_cast<std::uint32_t>(number(3)));
    }
    for (const auto& [who, role] : inputs.roles.known) {
      if (role != ROLE_NONE) apply_role(drawn, to_message(who), role);
    }
    return drawn;
  }

  /// Up to the limits of grants, and of the requests of one organisation.
  static void fill(Control& drawn) {
    for (std::size_t i = 0; i < contract::max_drone_requests; ++i)
      add_request(drawn, to_message({"Org2MSP", "CN=asks" + std::to_string(i)}), nullptr, 0);
    for (std::size_t i = 0; i < contract::max_drone_grants; ++i) {
      Grant grant;
      *grant.mutable_to() = to_message({"Org2MSP", "CN=is-granted" + std::to_string(i)});
      grant.set_stop(true);
      set_grant(drawn, grant, drawn.epoch());
    }
    Grant all;
    all.mutable_to()->set_msp_id("Org2MSP");
    all.set_fly(true);
    all.set_max_priority(3);
    set_grant(drawn, all, drawn.epoch());
  }

  std::mt19937 random_;
  std::vector<IdentityName> people_;
};

/// What the contract says of the call.
std::optional<Refusal> refusal_of(Draw& draw) {
  if (draw.call.function == contract::stop) {
    if (!draw.record.has_owner()) return Refusal{Rule::enrolled, not_enrolled_text()};
    const auto& drones = std::get<DronesCall>(draw.call.message);
    if (auto why = check_stop(draw.record, draw.caller, draw.role(), drones.cut())) return why;
    return check_clears(drones, "tello1", draw.caller, 0);
  }
  if (auto why = check_call(draw.call, draw.caller, draw.inputs.roles)) return why;
  if (draw.record.has_owner() && draw.one_of(8)) {
    if (auto why = check_claimed({to_message(draw.person())}, draw.record, draw.call.function, draw.caller)) return why;
  }
  const auto after = apply(draw.record, draw.call, draw.caller, draw.inputs);
  const auto* why = std::get_if<Refusal>(&after);
  return why != nullptr ? std::optional(*why) : std::nullopt;
}

constexpr unsigned draws = 6'000;

TEST(Access, EachFunctionRefusesByTheRulesThatItsRowOfThePageNames) {
  std::map<std::string, std::set<std::string_view>> seen, named;
  std::map<std::string, int> accepted;
  for (unsigned seed = 1; seed <= 3 * draws; ++seed) {
    Draw draw(seed);
    if (const auto why = refusal_of(draw)) {
      seen[draw.call.function].insert(id_of(why->rule));
      EXPECT_FALSE(why->text.empty());
    } else {
      ++accepted[draw.call.function];
    }
    for (const char* function : {contract::claim, contract::unclaim}) {
      if (!draw.record.has_owner()) {
        seen[function].insert(id_of(Rule::enrolled));
      } else if (claims_for_owner(draw.record.owner().msp_id(), draw.is_host(), draw.caller, draw.role())) {
        ++accepted[function];
      } else if (const auto why = check_holders_claim(draw.record, draw.caller, draw.role())) {
        seen[function].insert(id_of(why->rule));
      } else {
        ++accepted[function];
      }
    }
  }
  for (const FunctionText& one : all_functions()) {
    for (const Rule rule : one.rules) named[std::string(one.function)].insert(id_of(rule));
    EXPECT_GT(accepted[std::string(one.function)], 0) << one.function;
  }
  EXPECT_EQ(seen, named);
}

TEST(Access, EachRuleHasATextAndSomeFunctionAsksIt) {
  std::set<std::string_view> ids, asked;
  for (const RuleText& one : all_rules()) {
    EXPECT_TRUE(ids.insert(one.id).second) << one.id;
    EXPECT_FALSE(one.needs.empty());
  }
  for (const FunctionText& one : all_functions()) {
    for (const Rule rule : one.rules) asked.insert(id_of(rule));
  }
  EXPECT_EQ(ids, asked);
}

/// Records that a lying peer may say in place of this one.
std::vector<Control> others_than(const Control& record) {
  std::vector<Control> others(9, record);
  others[0].set_epoch(record.epoch() + 1);
  others[1].set_priority(record.priority() + 1);
  *others[2].mutable_holder() = to_message({"Org3MSP", "CN=thief"});
  *others[3].mutable_delegate() = to_message({"Org3MSP", "CN=thief"});
  *others[4].mutable_owner() = to_message({"Org1MSP", "CN=other"});
  others[5].clear_stoppers();
  others[6].clear_grants();
  others[7].clear_requests();
  others[8].clear_revoked();
  return others;
}

// What the contract writes, every reader of blocks takes, though it does not know the roles that the contract read. In
// its place it takes the record as it was before, which says nothing, and no other.
TEST(Access, WhatTheContractWritesFollowsAndNothingElseDoes) {
  int followed = 0, refused = 0;
  for (unsigned seed = 1; seed <= draws; ++seed) {
    Draw draw(seed);
    if (draw.call.function == contract::stop) continue;
    const auto becomes = apply(draw.record, draw.call, draw.caller, draw.inputs);
    const auto* after = std::get_if<Control>(&becomes);
    if (after == nullptr) continue;
    verification::ControlEvent event;
    event.call = draw.call;
    ++followed;
    const Status follows = verification::control_follows(event, draw.record, *after, draw.caller);
    EXPECT_TRUE(follows) << seed << " " << draw.call.function << ": " << follows.error().message;
    for (const Control& other : others_than(*after)) {
      const std::string bytes = other.SerializeAsString();
      if (bytes == after->SerializeAsString() || bytes == draw.record.SerializeAsString()) continue;
      const bool taken = verification::control_follows(event, draw.record, other, draw.caller).ok();
      // By a role that the caller may have for all that a reader knows: of a supervisor, and with any later epoch.
      const bool epoch_alone = other.epoch() != after->epoch() && after->epoch() != draw.record.epoch();
      const bool clears = draw.call.function == contract::clear_stop && other.stoppers().empty();
      EXPECT_FALSE(taken && !epoch_alone && !clears) << seed << " " << draw.call.function;
      refused += taken ? 0 : 1;
    }
  }
  EXPECT_GT(followed, 300);
  EXPECT_GT(refused, 1'500);
}

// By no rule of another's: who is of a third organisation, whatever its role there, and is granted nothing.
TEST(Access, AnOutsiderChangesNothing) {
  for (unsigned seed = 1; seed <= draws; ++seed) {
    Draw draw(seed);
    if (!draw.record.has_owner()) continue;
    draw.caller = {{"Org3MSP", "CN=outsider"}, draw.one_of(2)};
    draw.inputs.roles.known[draw.caller.name] = draw.one_of(2) ? SUPERVISOR : OPERATOR;
    EXPECT_TRUE(refusal_of(draw)) << seed << " " << draw.call.function;
    EXPECT_TRUE(check_holders_claim(draw.record, draw.caller, draw.role()));
  }
}

// The contract reads every role that the rules ask for: who has none may nothing by a role.
TEST(Access, ForTheContractARoleThatIsNotKnownIsNone) {
  LeaseCall lease;
  lease.add_drones("tello1");
  const Caller caller{{"Org1MSP", "CN=nobody"}};
  const Call call{contract::acquire, lease};
  EXPECT_TRUE(check_call(call, caller, {.all = true}));
  EXPECT_FALSE(check_call(call, caller, {}));
}

// Who is revoked by the record, though the reader knows no role of it.
TEST(Access, ADelegateWhomTheRecordSaysIsRevokedIsNone) {
  Control record;
  record.set_drone("tello1");
  *record.mutable_owner() = to_message({"Org1MSP", "CN=host"});
  *record.add_revoked() = to_message({"Org1MSP", "CN=station"});
  LeaseCall lease;
  lease.add_drones("tello1");
  *lease.mutable_delegate() = to_message({"Org1MSP", "CN=station"});
  const Caller caller{{"Org1MSP", "CN=pilot"}};
  const auto refused = apply(record, {contract::acquire, lease}, caller, {.new_epoch = 1});
  ASSERT_TRUE(std::holds_alternative<Refusal>(refused));
  EXPECT_EQ(std::get<Refusal>(refused).rule, Rule::delegate_role);
}

TEST(Access, ThePageIsWhatTheRulesSay) {
  std::ifstream file(LEDGERLINE_SOURCE "/docs/access.md");
  std::stringstream text;
  text << file.rdbuf();
  EXPECT_EQ(text.str(), access_page()) << "print it again: ledgerline contract rules > docs/access.md";
}

}  // namespace
}  // namespace ledgerline::access
