#include "ground/shell/operators.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <filesystem>

#include "common/base/log.hpp"
#include "common/fabric/calls/repeat.hpp"
#include "common/fabric/client/client.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline::ground {
namespace {

namespace fs = std::filesystem;
using service::OperatorCall;

constexpr fabric::RepeatLimits limits{.attempts = 10, .conflicts_only = true};

}  // namespace

Result<std::unique_ptr<OperatorService>> OperatorService::create(Parts parts) {
  std::unique_ptr<OperatorService> service(new OperatorService(std::move(parts)));
  const Parts& own = service->parts_;
  std::error_code error;
  std::vector<fs::path> found;
  for (fs::directory_iterator at(own.folder, error), end; !error && at != end; at.increment(error)) {
    if (at->is_directory(error)) found.push_back(at->path());
  }
  if (error) return Error{fmt::format("{}: {}", own.folder, error.message())};
  if (found.empty() || found.size() > max_operators)
    return Error{fmt::format("{} has {} operators; 1 to {} may be there", own.folder, found.size(), max_operators)};
  std::sort(found.begin(), found.end());
  for (const fs::path& folder : found) {
    const auto name = crypto::read_identity_name(own.ledgers.front().identity.name.msp_id, folder.string());
    if (!name) return Error{name.error().message};
    if (*name == own.ledgers.front().identity.name)
      return Error{fmt::format("{}: is ground's own identity, which no operator may sign with", folder.string())};
    service->operators_.push_back({folder.filename().string(), *name});
    service->folders_.push_back(folder.string());
  }
  service->clients_.resize(found.size());
  return service;
}

void OperatorService::close() {
  closed_ = true;
  worker_.close();
}

void OperatorService::unlock(std::size_t who, std::shared_ptr<const crypto::WipingString> pass_phrase,
                             std::function<void(Status)> answer) {
  const auto task = [this, who, phrase = std::move(pass_phrase), answer] {
    answer(closed_ ? Status(Error{"the ground ends"}) : open_key(who, *phrase));
  };
  if (!worker_.post(task)) answer(Error{"too much waits to be signed: try again"});
}

Status OperatorService::submit(std::size_t who, const OperatorCall& call) {
  if (clients_of(who).of_channel.empty()) return Error{"the key is locked: sign in again"};
  if (!worker_.post([this, who, call] { sign(who, call); })) return Error{"too much waits to be signed: try again"};
  return done;
}

bool OperatorService::stop(const crypto::IdentityName& who, std::size_t channel, const fabric::Call& call,
                           std::function<void(fabric::Outcome)> ended) {
  const auto known = std::ranges::find_if(operators_, [&](const auto& one) { return one.identity == who; });
  if (known == operators_.end()) return false;
  const Clients clients = clients_of(static_cast<std::size_t>(known - operators_.begin()));
  if (clients.of_channel.empty()) return false;
  clients.of_channel[channel].stops->submit(call, std::move(ended));
  return true;
}

void OperatorService::on_session_over(std::size_t who) {
  {
    const std::lock_guard lock(clients_mutex_);
    clients_[who].left = true;
  }
  parts_.on_session(who, false);
}

bool OperatorService::end_session(std::size_t who, const std::vector<std::size_t>& drones) {
  return worker_.post([this, who, drones] {
    for (const std::size_t drone : drones) sign(who, {.kind = OperatorCall::Kind::release, .drone = drone});
    set_clients(who, {});
    spdlog::info("operator {} signed out", operators_[who].name);
  });
}

Status OperatorService::open_key(std::size_t who, const crypto::WipingString& pass_phrase) {
  const auto& own = parts_.ledgers.front();
  std::string phrase(pass_phrase.view());
  auto identity = crypto::load_locked_identity(own.verifier, own.identity.name.msp_id, folders_[who], phrase);
  crypto::wipe(phrase);
  const service::Operator& one = operators_[who];
  if (!identity) {
    spdlog::warn("operator {} does not sign in: {}", one.name, identity.error().message);
    return Error{"the key is not unlocked: a wrong pass phrase, or else ground's log says why"};
  }
  Clients clients;
  for (fabric::ClientConfig config : parts_.ledgers) {
    config.identity = *identity;
    auto leases = fabric::Client::create(config), stops = fabric::Client::create(config);
    if (!leases || !stops) return (leases ? stops : leases).error();
    clients.of_channel.push_back({std::move(*leases), std::move(*stops)});
  }
  set_clients(who, std::move(clients));
  spdlog::info("operator {} signed in as {}", one.name, service::text_of(one.identity));
  parts_.on_session(who, true);
  return done;
}

void OperatorService::sign(std::size_t who, const OperatorCall& call) {
  if (closed_) return;
  const Clients clients = clients_of(who);
  const std::string drone = call.drone ? parts_.drones[*call.drone] : "";
  const std::string& name = operators_[who].name;
  const Status may = service::check_key({.unlocked = !clients.of_channel.empty(), .left = clients.left}, call.kind);
  if (!may) {
    service::CallUpdate refused = service::update_of(name, call, may.error().message);
    return parts_.report(refused.level, drone, std::move(refused.words));
  }
  const fabric::Call contract = service::contract_call(call, drone, parts_.ledgers.front().identity.name);
  // A mission is approved on the channel of [ledger], whatever those of its drones.
  const std::size_t channel = call.drone ? parts_.channel_of(*call.drone) : 0;
  fabric::Outcome outcome =
      verification::submit_claiming(*clients.of_channel[channel].leases, contract, {drone}, limits, nullptr);
  // Ground signs for those without a session: any operator who is signed in may clear that stop, but no other
  // operator's.
  if (call.ground_too && service::may_clear_ground_stop(outcome, drone)) {
    spdlog::info("operator {} clears ground's own stop of {}", name, drone);
    outcome = parts_.clear_ground_stop(channel, contract);
  }
  service::CallUpdate update = service::update_of(name, call, outcome);
  parts_.report(update.level, drone, std::move(update.words));
}

OperatorService::Clients OperatorService::clients_of(std::size_t who) const {
  const std::lock_guard lock(clients_mutex_);
  return clients_[who];
}

void OperatorService::set_clients(std::size_t who, Clients clients) {
  {
    const std::lock_guard lock(clients_mutex_);
    std::swap(clients_[who], clients);
  }  // the old ones end here, behind the lock
}

void RoleWatch::close() {
  closed_ = true;
  worker_.close();
  read_.close();
}

void RoleWatch::on_block(const fabric::Block& block) {
  if (service::changes_roles(block)) wanted_.request();
}

const std::vector<std::size_t>& RoleWatch::step(TimeNs now) {
  for (const Result<verification::RolesByOrganisation>& roles : read_.pop_all()) {
    is_reading_ = false;
    if (roles) {
      dismissed_ = service::dismissed(parts_.operators, *roles);
    } else {
      spdlog::warn("whether the operators' roles still hold cannot be read yet: {}", roles.error().message);
      wanted_.request();
    }
  }
  if (is_reading_ || !wanted_.start(now)) return dismissed_;
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
  if (!is_reading_) wanted_.request();
  return dismissed_;
}

OperatorSessions::OperatorSessions(Parts parts) : parts_(std::move(parts)) {
  for (const verification::Evaluate& evaluate : parts_.ledgers) {
    roles_.push_back(std::make_unique<RoleWatch>(
        RoleWatch::Parts{.operators = parts_.service->operators(), .evaluate = evaluate, .wake = parts_.wake}));
  }
}

void OperatorSessions::await_all(TimeNs now_ns) {
  for (std::size_t who = 0; who < parts_.service->operators().size(); ++who) ended_.add(who, now_ns + parts_.idle_ns);
}

void OperatorSessions::change(std::size_t who, bool in, TimeNs now_ns) {
  in ? ended_.remove(who) : ended_.add(who, now_ns);
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
      if (std::ranges::find(dismissed_, who) != dismissed_.end()) continue;
      const std::string& name = operators[who].name;
      parts_.warn(fmt::format("{} is no operator any more: signed out, and what {} holds lands", name, name));
    }
    dismissed_ = std::move(dismissed);
  }
  // Each time: what is flown now is still theirs.
  for (const std::size_t who : dismissed_) parts_.disown(operators[who].identity);
}

void OperatorSessions::end_sessions(TimeNs now_ns) {
  for (const std::size_t who : ended_.all()) {
    const crypto::IdentityName& identity = parts_.service->operators()[who].identity;
    const service::HeldDrones held = service::drones_held_by(parts_.view, identity);
    const service::EndedSessions::Step step = ended_.step(now_ns, who, held);
    for (const std::size_t drone : step.land) parts_.post_command({.drone = drone, .by = identity, .land = true});
    if (!step.give_back) continue;
    const bool is_posted = parts_.service->end_session(who, held.drones);  // false: too much waits to be signed
    if (!is_posted && step.last) parts_.service->forget(who);
    if (is_posted || step.last) ended_.remove(who);
  }
}

}  // namespace ledgerline::ground
