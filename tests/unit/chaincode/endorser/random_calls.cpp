#include "tests/unit/chaincode/endorser/random_calls.hpp"

#include <algorithm>

#include "ledgerline.pb.h"
#include "msp/identities.pb.h"

namespace ledgerline::endorser {
namespace {

void set(Identity& identity, const crypto::IdentityName& name) {
  identity.set_msp_id(name.msp_id);
  identity.set_subject(name.subject);
}

const char* const steady_drone = "tello9";
constexpr std::uint64_t first_epoch = 1;  // it is acquired once

std::string enrolment(const crypto::IdentityName& who, const std::vector<std::string>& drones, Role role) {
  EnrollCall call;
  set(*call.mutable_identity(), who);
  call.mutable_drones()->Assign(drones.begin(), drones.end());
  call.set_role(role);
  return call.SerializeAsString();
}

std::string grant(const std::vector<std::string>& drones) {
  GrantCall call;
  call.mutable_drones()->Assign(drones.begin(), drones.end());
  call.mutable_grant()->mutable_to()->set_msp_id("Org2MSP");
  call.mutable_grant()->set_fly(true);
  call.mutable_grant()->set_max_priority(10);
  return call.SerializeAsString();
}

std::string lease(const std::vector<std::string>& drones) {
  LeaseCall call;
  call.mutable_drones()->Assign(drones.begin(), drones.end());
  return call.SerializeAsString();
}

}  // namespace

const char* name_of(Kind kind) {
  return std::find_if(std::begin(shares), std::end(shares), [&](const Share& one) { return one.kind == kind; })->name;
}

std::vector<CallOf> steady_calls(const std::vector<crypto::IdentityName>& people) {
  return {{admin, {"enroll", {enrolment(people[steady_host], {steady_drone}, ROLE_NONE)}}},
          {second_admin, {"enroll", {enrolment(people[steady_holder], {}, OPERATOR)}}},
          {admin, {"grant", {grant({steady_drone})}}},
          {steady_holder, {"acquire", {lease({steady_drone})}}}};
}

std::vector<CallOf> usual_calls(const std::vector<crypto::IdentityName>& people) {
  const std::vector<std::string> drones{"tello1", "tello2", "tello3", "tello4"};
  return {{admin, {"enroll", {enrolment(people[host], drones, ROLE_NONE)}}},
          {second_admin, {"enroll", {enrolment(people[second_operator], {}, OPERATOR)}}},
          {admin, {"grant", {grant(drones)}}},
          {second_operator, {"acquire", {lease({"tello1", "tello2"})}}}};
}

std::vector<crypto::SigningIdentity> wrong_creators(const crypto::SigningIdentity& one,
                                                    const crypto::SigningIdentity& other) {
  msp::SerializedIdentity own;
  own.ParseFromString(one.serialized);
  msp::SerializedIdentity of_another_msp = own, without_certificate = own;
  of_another_msp.set_mspid("Org9MSP");
  without_certificate.set_id_bytes("?");
  // Of an authority that has the organisation's name, and not its key.
  const auto authority = crypto::make_ca("ca.org1.ledgerline", "org1.ledgerline");
  const auto made =
      crypto::issue(*authority, {.common_name = "outsider", .organization = "", .unit = "client", .sans = {}});
  msp::SerializedIdentity of_nobody = own;
  of_nobody.set_id_bytes(made->certificate_pem);
  return {{one.name, of_another_msp.SerializeAsString(), one.signer},
          {one.name, without_certificate.SerializeAsString(), one.signer},
          {one.name, of_nobody.SerializeAsString(), *crypto::make_signer(crypto::Library::libcrypto, made->key_pem)},
          {one.name, one.serialized, other.signer}};
}

Kind Calls::next_kind() {
  if (deck_.empty()) {
    for (const Share& share : shares) deck_.insert(deck_.end(), static_cast<std::size_t>(share.of_twenty), share.kind);
    for (std::size_t i = deck_.size(); i > 1; --i) std::swap(deck_[i - 1], deck_[pick(i)]);
  }
  const Kind kind = deck_.back();
  deck_.pop_back();
  return kind;
}

fabric::Call Calls::command() {
  CommandCall call;
  call.set_organisation("Org1MSP");
  DronePlan& plan = *call.add_plans();
  plan.set_drone(steady_drone);
  plan.set_epoch(first_epoch);
  plan.set_action(FLY);
  for (std::size_t i = 0; i <= pick(20); ++i) plan.add_setpoints()->set_at_ns(setpoint_ns_ += 10'000'000);
  return {"command", {call.SerializeAsString()}};
}

fabric::Call Calls::state() {
  SetCall call;
  Asset& asset = *call.add_assets();
  asset.set_id(std::string(steady_drone) + "/odom");
  asset.set_msg_type("nav_msgs/msg/Odometry");
  asset.set_msg_data(std::string(1 + pick(300), static_cast<char>('a' + pick(26))));
  call.set_stream(true);
  return {"set", {call.SerializeAsString()}};
}

fabric::Call Calls::any() {
  static const std::vector<std::string> functions{
      "set",     "set",     "set",     "set",     "delete", "get",       "get",     "get",        "command",
      "command", "acquire", "release", "request", "deny",   "hand_over", "stop",    "clear_stop", "apply_stops",
      "evict",   "enroll",  "revoke",  "grant",   "anchor", "verify",    "nothing", "claim",      "unclaim"};
  const std::string& function = functions[pick(functions.size())];
  if (pick(20) == 0) return {function, {word()}};
  if (pick(40) == 0) return {function, {}};
  return {function, {arguments_of(function)}};
}

std::string Calls::word() {
  static const std::vector<std::string> words{"",
                                              "tello1",
                                              "tello1/",
                                              "tello2/key1",
                                              "control/tello1",
                                              "*",
                                              "\xff\x01",
                                              "lease/x",
                                              "{\"id\":\"tello1/key1\"}",
                                              "zzz"};
  return words[pick(words.size())];
}

std::string Calls::arguments_of(const std::string& function) {
  const auto name = [&](Identity& identity) {
    const crypto::IdentityName& one = people_[pick(steady_holder)];
    set(identity, one);
    if (pick(8) == 0) identity.set_msp_id("Org9MSP");
  };
  const auto drones_of = [&](auto call) {
    for (std::size_t i = 0; i <= pick(2); ++i) call.add_drones(drone());
    return call.SerializeAsString();
  };
  if (function == "set") {
    SetCall call;
    for (std::size_t i = 0; i <= pick(3); ++i) {
      Asset& asset = *call.add_assets();
      asset.set_id(id());
      asset.set_msg_type("std_msgs/msg/String");
      asset.set_msg_data(std::string(1 + pick(300), static_cast<char>('a' + pick(26))));
    }
    call.set_stream(pick(3) == 0);
    return call.SerializeAsString();
  }
  if (function == "delete") {
    DeleteCall call;
    call.set_id(id());
    return call.SerializeAsString();
  }
  if (function == "get") {
    static const std::vector<std::string> asked{"*",           "tello1/*",    "tello2/*",      "control/*",
                                                "tello1/key1", "tello3/key9", "control/tello1"};
    QueryCall call;
    call.set_id(pick(3) == 0 ? id() : asked[pick(asked.size())]);
    if (pick(4) == 0) call.set_bookmark(id());
    return call.SerializeAsString();
  }
  if (function == "command") {
    CommandCall call;
    call.set_organisation(pick(10) == 0 ? "Org2MSP" : "Org1MSP");
    DronePlan& plan = *call.add_plans();
    plan.set_drone("tello" + std::to_string(1 + pick(3)));
    plan.set_epoch(pick(6));
    plan.set_action(FLY);
    plan.add_setpoints()->set_at_ns(1000);
    return call.SerializeAsString();
  }
  if (function == "revoke") {
    RevokeCall call;
    name(*call.mutable_identity());
    return call.SerializeAsString();
  }
  if (function == "enroll") {
    EnrollCall call;
    name(*call.mutable_identity());
    if (pick(2) == 0) call.add_drones(drone());
    if (pick(2) == 0) call.set_role(OPERATOR);
    return call.SerializeAsString();
  }
  if (function == "grant") {
    GrantCall call;
    call.add_drones(drone());
    name(*call.mutable_grant()->mutable_to());
    call.mutable_grant()->set_fly(pick(2) == 0);
    call.mutable_grant()->set_max_priority(static_cast<std::uint32_t>(pick(10)));
    return call.SerializeAsString();
  }
  if (function == "hand_over" || function == "deny") {
    AnswerCall call;
    name(*call.mutable_to());
    return drones_of(std::move(call));
  }
  if (function == "anchor" || function == "verify") {
    AnchorCall call;
    call.set_digest(std::string(pick(6) == 0 ? 5 : 32, static_cast<char>(pick(4))));
    call.set_what("data");
    return call.SerializeAsString();
  }
  if (function == "acquire" || function == "release" || function == "request") {
    LeaseCall call;
    call.set_priority(static_cast<std::uint32_t>(pick(5)));
    if (pick(3) == 0) name(*call.mutable_delegate());
    return drones_of(std::move(call));
  }
  DronesCall call;
  call.set_cut(pick(4) == 0);
  return drones_of(std::move(call));
}

}  // namespace ledgerline::endorser
