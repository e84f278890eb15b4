#include "ground/shell/operators/sessions.hpp"

#include <fmt/format.h>

#include <algorithm>

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
  for (const Result<verification::Roles>& roles : read_.pop_all()) {
    is_reading_ = false;
    if (roles) {
      dismissed_ = service::dismissed(parts_.operators, *roles);
    } else {
      spdlog::warn("whether the operators' roles still hold cannot be read yet: {}", roles.error().message);
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

OperatorSessions::OperatorSessions(Parts parts) : parts_(std::move(parts)) {
  for (const verification::Evaluate& evaluate : parts_.ledgers) {
    roles_.push_back(std::make_unique<RoleWatch>(
        RoleWatch::Parts{.operators = parts_.service->operators(), .evaluate = evaluate, .wake = parts_.wake}));
  }
}

void OperatorSessions::await_all(TimeNs now_ns) {
  for (std::size_t who = 0; who < parts_.service->operators().size(); ++who) leaving_.add(who, now_ns + parts_.idle_ns);
}

void OperatorSessions::change(std::size_t who, bool in, TimeNs now_ns) {
  in ? leaving_.remove(who) : leaving_.add(who, now_ns);
}

void OperatorSessions::step(TimeNs now_ns) {
  dismiss(now_ns);
  end_sessions(now_ns);
}

void OperatorSessions::close() {
  for (const auto& roles : roles_) roles->close();
  parts_.service->close();
}

void OperatorSessions::dismiss(TimeNs now_ns) {
  const std::vector<service::Operator>& operators = parts_.service->operators();
  std::vector<std::size_t> dismissed;
  for (const auto& roles : roles_) {
    const auto& of_channel = roles->step(now_ns);
    dismissed.insert(dismissed.end(), of_channel.begin(), of_channel.end());
  }
  if (dismissed != dismissed_) {
    parts_.dismiss(dismissed);
    for (const std::size_t who : dismissed) {
      if (std::find(dismissed_.begin(), dismissed_.end(), who) != dismissed_.end()) continue;
      const std::string& name = operators[who].name;
      parts_.warn(fmt::format("{} is no operator any more: signed out, and what {} holds lands", name, name));
    }
    dismissed_ = std::move(dismissed);
  }
  // Each time: what is flown now is still theirs.
  for (const std::size_t who : dismissed_) parts_.disown(operators[who].identity);
}

void OperatorSessions::end_sessions(TimeNs now_ns) {
  for (const std::size_t who : leaving_.all()) {
    const crypto::IdentityName& identity = parts_.service->operators()[who].identity;
    const service::Held held = service::held_by(parts_.view, identity);
    const service::Leaving::Step step = leaving_.step(now_ns, who, held);
    for (const std::size_t drone : step.land) parts_.post_command({.drone = drone, .by = identity, .land = true});
    if (!step.give_back) continue;
    const bool is_posted = parts_.service->end_session(who, held.drones);  // false: too much waits to be signed
    if (!is_posted && step.last) parts_.service->forget(who);
    if (is_posted || step.last) leaving_.remove(who);
  }
}

}  // namespace ledgerline::ground
