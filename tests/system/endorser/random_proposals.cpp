// Asks an organisation's own endorser and its peer the same random proposals, and says how their answers differ.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "chaincode/endorser/core/comparison.hpp"
#include "common/fabric/asking/peer_questions.hpp"
#include "common/fabric/config.hpp"
#include "common/rt/clock.hpp"
#include "ledgerline.pb.h"
#include "peer/proposal_response.pb.h"
#include "tests/system/connect.hpp"

namespace {

using namespace ledgerline;

struct Person {
  fabric::ClientConfig config;
  std::unique_ptr<fabric::Client> client;
};

/// Calls of every function: good ones, refusals, keys that are there and are not, pages, and what is no call at all.
class Calls {
 public:
  Calls(std::uint64_t seed, std::vector<crypto::IdentityName> people) : random_(seed), people_(std::move(people)) {}

  fabric::Call next() {
    static const std::vector<std::string> functions{
        "set",     "set",     "set",     "set",     "delete", "get",       "get",    "get",    "command",
        "command", "acquire", "release", "request", "deny",   "hand_over", "stop",   "resume", "fold",
        "evict",   "enroll",  "revoke",  "grant",   "anchor", "verify",    "nothing"};
    const std::string& function = functions[pick(functions.size())];
    if (pick(20) == 0) return {function, {word()}};
    if (pick(40) == 0) return {function, {}};
    return {function, {arguments_of(function)}};
  }
  std::size_t pick(std::size_t count) { return random_() % count; }

 private:
  std::string drone() { return "tello" + std::to_string(1 + pick(6)); }
  std::string id() { return drone() + "/key" + std::to_string(pick(60)); }
  std::string word() {
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
  void name(Identity& identity) {
    const crypto::IdentityName& one = people_[pick(people_.size())];
    identity.set_msp_id(pick(8) == 0 ? "Org9MSP" : one.msp_id);
    identity.set_subject(one.subject);
  }
  template <typename Call>
  std::string drones_of(Call call) {
    for (std::size_t i = 0; i <= pick(2); ++i) call.add_drones(drone());
    return call.SerializeAsString();
  }

  std::string arguments_of(const std::string& function) {
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
      return drones_of(std::move(call));
    }
    DronesCall call;
    call.set_cut(pick(4) == 0);
    return drones_of(std::move(call));
  }

  std::mt19937_64 random_;
  const std::vector<crypto::IdentityName> people_;
};

struct Told {
  std::map<std::string, int> same, unanswered, refusals;
  int other_state = 0, differ = 0, committed = 0, invalid = 0;
  std::string first_difference;
};

/// Org1's drones with their host, and an operator of Org2 that flies some: so that calls of all kinds can succeed. `people`: as
/// test_endorser.py has them. What did not go, in words.
std::string prepare(std::vector<Person>& people) {
  EnrollCall drones, operators;
  GrantCall grant;
  LeaseCall lease;
  for (int k = 1; k <= 4; ++k) drones.add_drones("tello" + std::to_string(k));
  for (int k = 1; k <= 2; ++k) lease.add_drones("tello" + std::to_string(k));
  const auto set = [](Identity& identity, const Person& who) {
    identity.set_msp_id(who.config.identity.name.msp_id);
    identity.set_subject(who.config.identity.name.subject);
  };
  set(*drones.mutable_identity(), people[0]);
  set(*operators.mutable_identity(), people[3]);
  operators.set_role(OPERATOR);
  *grant.mutable_drones() = drones.drones();
  grant.mutable_grant()->mutable_to()->set_msp_id("Org2MSP");
  grant.mutable_grant()->set_fly(true);
  grant.mutable_grant()->set_max_priority(10);
  const std::vector<std::pair<std::size_t, fabric::Call>> calls{{1, {"enroll", {drones.SerializeAsString()}}},
                                                                {2, {"enroll", {operators.SerializeAsString()}}},
                                                                {1, {"grant", {grant.SerializeAsString()}}},
                                                                {3, {"acquire", {lease.SerializeAsString()}}}};
  std::string problems;
  for (const auto& [who, call] : calls) {
    const fabric::Outcome outcome = people[who].client->submit_and_wait(call);
    if (outcome.kind != fabric::Outcome::Kind::committed) problems += call.function + ": " + outcome.message + "\n";
  }
  return problems;
}

/// Until both have read the same versions.
endorser::Comparison ask_both(fabric::PeerQuestions& own, fabric::PeerQuestions& peer, const std::string& proposal,
                              const std::string& function, Told& told) {
  endorser::Comparison found = endorser::Comparison::other_state;
  for (int tried = 0; tried < 200 && found == endorser::Comparison::other_state; ++tried) {
    if (tried > 0) {
      ++told.other_state;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    const auto mine = own.propose(proposal), theirs = peer.propose(proposal);
    if (!mine) {
      const bool words_differ = !theirs && mine.error().what != theirs.error().what;
      if (words_differ) told.first_difference = mine.error().what + " | " + theirs.error().what;
      if (!words_differ) ++told.unanswered[function + ": " + mine.error().what];
      return words_differ ? endorser::Comparison::differ : endorser::Comparison::same;
    }
    if (!theirs) {
      told.first_difference = function + ": the peer alone refuses: " + theirs.error().what;
      return endorser::Comparison::differ;
    }
    protos::ProposalResponse response;
    response.ParseFromString(*mine);
    found = endorser::compare(*mine, *theirs);
    if (found == endorser::Comparison::same) {
      ++told.same[function];
      if (response.response().status() >= 400) ++told.refusals[function];
    } else if (found == endorser::Comparison::differ && told.first_difference.empty()) {
      protos::ProposalResponse other;
      other.ParseFromString(*theirs);
      told.first_difference = function + "\n" + response.ShortDebugString() + "\n" + other.ShortDebugString();
    }
  }
  return found;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Asks an own endorser and its peer the same random proposals"};
  std::vector<std::string> configs;
  std::string endpoint, tls_ca;
  std::uint64_t seed = 1;
  int count = 500;
  app.add_option("--config", configs, "TOML files with [ledger], one a person; the peer asked is the first one's")
      ->required();
  app.add_option("--endorser", endpoint, "HOST:PORT")->required();
  app.add_option("--tls-ca", tls_ca, "of the endorser's certificate")->required();
  app.add_option("--count", count);
  app.add_option("--seed", seed);
  CLI11_PARSE(app, argc, argv);

  std::vector<Person> people;
  std::vector<crypto::IdentityName> names;
  for (const std::string& file : configs) {
    people.push_back({ledger_of(file), connect(file)});
    names.push_back(people.back().config.identity.name);
  }
  fabric::ClientConfig at_endorser = people.front().config;
  at_endorser.endpoint = endpoint;
  at_endorser.tls_ca_file = tls_ca;
  auto own = fabric::PeerQuestions::create(at_endorser);
  auto peer = fabric::PeerQuestions::create(people.front().config);
  if (!own || !peer) {
    std::fprintf(stderr, "%s\n", (own ? peer.error() : own.error()).what.c_str());
    return 1;
  }
  if (people.size() < 5) return 1;
  if (const std::string problems = prepare(people); !problems.empty()) {
    std::fprintf(stderr, "%s", problems.c_str());
    return 1;
  }
  Calls calls(seed, names);
  Told told;
  for (int i = 0; i < count; ++i) {
    // Random calls have revoked and evicted people, and deleted what there was.
    if (i % 50 == 49) (void)prepare(people);
    const fabric::Call call = calls.next();
    const std::size_t usual = call.function == "command" ? 3 : 0;
    Person& who = people[calls.pick(3) == 0 ? calls.pick(people.size()) : usual];
    const auto proposal =
        fabric::make_proposal(who.config.identity, who.config.where, call, realtime_ns(), crypto::random_bytes(24));
    if (ask_both(**own, **peer, proposal->signed_proposal, call.function, told) != endorser::Comparison::same)
      ++told.differ;
    if (calls.pick(4) != 0 || call.function == "get" || call.function == "verify") continue;
    const fabric::Outcome outcome = who.client->submit_and_wait(call);
    if (outcome.kind == fabric::Outcome::Kind::committed) ++told.committed;
    if (outcome.kind == fabric::Outcome::Kind::invalidated) ++told.invalid;
  }
  std::printf("%s\n", nlohmann::json{{"same", told.same},
                                     {"unanswered", told.unanswered},
                                     {"refusals", told.refusals},
                                     {"other_state", told.other_state},
                                     {"differ", told.differ},
                                     {"committed", told.committed},
                                     {"invalid", told.invalid},
                                     {"first_difference", told.first_difference}}
                          .dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)
                          .c_str());
  return 0;
}
