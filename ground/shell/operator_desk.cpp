#include "ground/shell/operator_desk.hpp"

#include <fmt/format.h>
#include <openssl/crypto.h>

#include <algorithm>
#include <cstring>
#include <filesystem>

#include "common/base/log.hpp"
#include "common/fabric/client/repeated.hpp"

namespace ledgerline::ground {
namespace {

namespace fs = std::filesystem;
using service::OperatorCall;

constexpr TimeNs end_check_ns = 200 * ns_per_ms;  // until the worker looks whether to end
constexpr fabric::RepeatLimits limits{.attempts = 10, .conflicts_only = true};

}  // namespace

Result<std::unique_ptr<OperatorDesk>> OperatorDesk::create(Parts parts) {
  std::unique_ptr<OperatorDesk> desk(new OperatorDesk(std::move(parts)));
  const Parts& own = desk->parts_;
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
    const auto name = crypto::read_identity_name(own.ledger.identity.name.msp_id, folder.string());
    if (!name) return Error{name.error().what};
    if (*name == own.ledger.identity.name)
      return Error{fmt::format("{}: is ground's own identity, which no operator may sign with", folder.string())};
    desk->operators_.push_back({folder.filename().string(), *name});
    desk->folders_.push_back(folder.string());
  }
  desk->clients_.resize(found.size());
  desk->worker_ = std::jthread([&self = *desk](const std::stop_token& quit) { self.work(quit); });
  return desk;
}

void OperatorDesk::close() {
  if (!worker_.joinable()) return;
  tasks_.close();
  worker_.request_stop();
  tasks_.wake();
  worker_.join();
  for (const Task& thrown : tasks_.take_all()) (void)thrown;
}

void OperatorDesk::unlock(std::size_t who, std::string pass_phrase, std::function<void(Status)> answer) {
  if (waiting_ >= max_waiting) return answer(Error{"too much waits to be signed: try again"});
  ++waiting_;
  tasks_.put(Unlock{who, std::move(pass_phrase), std::move(answer)});
}

Status OperatorDesk::submit(std::size_t who, const OperatorCall& call) {
  if (!clients_of(who).leases) return Error{"the key is locked: sign in anew"};
  if (waiting_ >= max_waiting) return Error{"too much waits to be signed: try again"};
  ++waiting_;
  tasks_.put(Sign{who, call});
  return done;
}

void OperatorDesk::stop(const crypto::IdentityName& who, fabric::Call call,
                        std::function<void(fabric::Outcome)> ended) {
  const auto known =
      std::find_if(operators_.begin(), operators_.end(), [&](const auto& one) { return one.identity == who; });
  const Clients clients =
      known == operators_.end() ? Clients{} : clients_of(static_cast<std::size_t>(known - operators_.begin()));
  if (clients.stops) return clients.stops->submit(std::move(call), std::move(ended));
  ended(fabric::Outcome::failed(fabric::Outcome::Kind::unavailable, "the key of " + who.subject + " is locked"));
}

void OperatorDesk::forget(std::size_t who) { tasks_.put(Forget{who}); }

void OperatorDesk::work(const std::stop_token& quit) {
  while (!quit.stop_requested()) {
    tasks_.wait(end_check_ns);
    for (Task& task : tasks_.take_all()) {
      if (quit.stop_requested()) return;
      std::visit([this](auto& one) { run(one); }, task);
    }
  }
}

void OperatorDesk::run(Unlock& task) {
  --waiting_;
  const auto& own = parts_.ledger;
  auto identity =
      crypto::load_locked_identity(own.verifier, own.identity.name.msp_id, folders_[task.who], task.pass_phrase);
  ::explicit_bzero(task.pass_phrase.data(), task.pass_phrase.size());
  const std::string& name = operators_[task.who].name;
  if (!identity) {
    spdlog::warn("operator {} does not sign in: {}", name, identity.error().what);
    return task.answer(Error{"the key is not unlocked: a wrong pass phrase, or else ground's log says why"});
  }
  fabric::ClientConfig config = own;
  config.identity = std::move(*identity);
  auto leases = fabric::Client::create(config), stops = fabric::Client::create(config);
  if (!leases || !stops) return task.answer((leases ? stops : leases).error());
  set_clients(task.who, {std::move(*leases), std::move(*stops)});
  spdlog::info("operator {} signed in as {} {}", name, operators_[task.who].identity.msp_id,
               operators_[task.who].identity.subject);
  parts_.on_session(task.who, true);
  task.answer(done);
}

void OperatorDesk::run(Sign& task) {
  --waiting_;
  const Clients clients = clients_of(task.who);
  const std::string what = fmt::format("{}: {}", operators_[task.who].name, service::words_of(task.call.kind));
  if (!clients.leases)
    return parts_.tell(service::Level::warning, task.call.drone, what + ": his key is locked by now");
  const fabric::Call call =
      service::contract_call(task.call, parts_.drones[task.call.drone], parts_.ledger.identity.name);
  const fabric::Outcome outcome = fabric::submit_repeatedly(*clients.leases, call, limits, nullptr);
  if (outcome.kind == fabric::Outcome::Kind::committed) return parts_.tell(service::Level::info, task.call.drone, what);
  parts_.tell(service::Level::warning, task.call.drone,
              fmt::format("{}: refused: {}", what, outcome.refusal ? outcome.refusal->words : outcome.message));
}

void OperatorDesk::run(Forget& task) {
  set_clients(task.who, {});
  spdlog::info("operator {} signed out", operators_[task.who].name);
}

OperatorDesk::Clients OperatorDesk::clients_of(std::size_t who) const {
  const std::lock_guard lock(clients_mutex_);
  return clients_[who];
}

void OperatorDesk::set_clients(std::size_t who, Clients clients) {
  {
    const std::lock_guard lock(clients_mutex_);
    std::swap(clients_[who], clients);
  }  // the old ones end here, behind the lock
}

}  // namespace ledgerline::ground
