#include "chaincode/identities/first_enrolments.hpp"

#include "ledgerline.pb.h"

namespace ledgerline {

constexpr int first_drones = 16;

std::string FirstEnrolment::call(const crypto::IdentityName& user) const {
  EnrollCall call;
  call.mutable_identity()->set_msp_id(user.msp_id);
  call.mutable_identity()->set_subject(user.subject);
  for (const std::string& drone : drones) call.add_drones(drone);
  if (is_operator) call.set_role(OPERATOR);
  return call.SerializeAsString();
}

std::vector<FirstEnrolment> first_enrolments() {
  FirstEnrolment host{1, {}, false};
  for (int number = 1; number <= first_drones; ++number) host.drones.push_back("tello" + std::to_string(number));
  return {host, {2, {}, true}};
}

}  // namespace ledgerline
