#include "chaincode/node/core/types.hpp"

namespace ledgerline::node {

Result<std::shared_ptr<const crypto::MspRegistry::Member>> MemberCheck::check_own(std::string_view serialized,
                                                                                  Now now) const {
  auto member = registry_->member(serialized, now.real_ns / ns_per_s);
  if (!member) return Error{"access denied: channel [" + channel_ + "] creator org unknown: " + member.error().message};
  return member;
}

Result<std::shared_ptr<const crypto::MspRegistry::Member>> MemberCheck::check(std::string_view serialized,
                                                                              std::string_view message,
                                                                              std::string_view signature,
                                                                              Now now) const {
  auto member = check_own(serialized, now);
  if (!member) return member;
  if (!(*member)->verifier->verify(message, signature)) {
    return Error{"access denied: channel [" + channel_ + "] creator org [" + (*member)->name.msp_id +
                 "]: the signature is invalid"};
  }
  return member;
}

}  // namespace ledgerline::node
