#include "ground/shell/operators/role_watch.hpp"

#include "common/base/log.hpp"

namespace ledgerline::ground {

void RoleWatch::close() {
  closed_ = true;
  worker_.close();
  read_.close();
}

void RoleWatch::look(const fabric::Block& block) {
  if (service::changes_roles(block)) wanted_.want();
}

const std::vector<std::size_t>& RoleWatch::step(TimeNs now) {
  for (const Result<verification::Roles>& roles : read_.take_all()) {
    is_reading_ = false;
    if (roles) {
      dismissed_ = service::dismissed(parts_.operators, *roles);
    } else {
      spdlog::warn("whether the operators' roles still hold cannot be read yet: {}", roles.error().what);
      wanted_.want();
    }
  }
  if (is_reading_ || !wanted_.take(now)) return dismissed_;
  is_reading_ = worker_.post([this] {
    const auto evaluate = [this](const fabric::Call& call) -> Result<std::string> {
      if (closed_) return Error{"the ground ends"};
      return parts_.evaluate(call);
    };
    verification::Organisations organisations;
    for (const service::Operator& one : parts_.operators) organisations.insert(one.identity.msp_id);
    read_.put(verification::read_roles(evaluate, organisations));
    parts_.wake();
  });
  if (!is_reading_) wanted_.want();
  return dismissed_;
}

}  // namespace ledgerline::ground
