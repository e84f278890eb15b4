#include "ground/shell/operators/operator_service.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "common/base/log.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/client/repeat.hpp"
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
  const auto known =
      std::find_if(operators_.begin(), operators_.end(), [&](const auto& one) { return one.identity == who; });
  if (known == operators_.end()) return false;
  const Clients clients = clients_of(static_cast<std::size_t>(known - operators_.begin()));
  if (clients.of_channel.empty()) return false;
  clients.of_channel[channel].stops->submit(call, std::move(ended));
  return true;
}

void OperatorService::leave(std::size_t who) {
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
    service::CallUpdate refused = service::news_of(name, call, may.error().message);
    return parts_.tell(refused.level, drone, std::move(refused.words));
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
  service::CallUpdate news = service::news_of(name, call, outcome);
  parts_.tell(news.level, drone, std::move(news.words));
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

}  // namespace ledgerline::ground
