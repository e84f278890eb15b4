#include "chaincode/identities/first_calls.hpp"

#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

namespace ledgerline {
namespace {

constexpr int first_drones = 16;

template <typename Message>
void add_drones(Message& call) {
  for (int number = 1; number <= first_drones; ++number) call.add_drones("tello" + std::to_string(number));
}

EnrollCall enrolment(const crypto::IdentityName& user) {
  EnrollCall call;
  call.mutable_identity()->set_msp_id(user.msp_id);
  call.mutable_identity()->set_subject(user.subject);
  return call;
}

GrantCall grant_to_operators() {
  GrantCall call;
  add_drones(call);
  Grant& grant = *call.mutable_grant();
  grant.mutable_to()->set_msp_id("Org2MSP");
  grant.set_fly(true);
  grant.set_stop(true);
  grant.set_cut(true);
  grant.set_max_priority(contract::max_priority);
  return call;
}

}  // namespace

std::vector<FirstCall> first_calls(int organisation, const crypto::IdentityName& user) {
  EnrollCall enroll = enrolment(user);
  if (organisation == 1) {
    add_drones(enroll);
    return {{contract::enroll, enroll.SerializeAsString()},
            {contract::grant, grant_to_operators().SerializeAsString()}};
  }
  if (organisation != 2) return {};
  enroll.set_role(OPERATOR);
  return {{contract::enroll, enroll.SerializeAsString()}};
}

}  // namespace ledgerline
