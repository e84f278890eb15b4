// Asks an organisation's own endorser and its peer the same random proposals, and says how their answers differ.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "chaincode/endorser/core/peer_follower.hpp"
#include "common/base/file.hpp"
#include "common/common.pb.h"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/rt/clock.hpp"
#include "msp/identities.pb.h"
#include "peer/proposal_response.pb.h"
#include "tests/system/connect.hpp"
#include "tests/unit/chaincode/endorser/random_calls.hpp"

namespace {

using namespace ledgerline;
using endorser::Kind;

struct Person {
  fabric::ClientConfig config;
  std::unique_ptr<fabric::Client> client;
};

/// Of each kind: the answers that were the same, by what they were.
struct Tally {
  int asked = 0, endorsed = 0, refused = 0;  ///< by the contract
  int unanswered = 0;                        ///< refused by both before the contract was asked
  int left_to_the_peer = 0;                  ///< the peer answers, and the endorser says that only it can
};

struct Report {
  std::map<Kind, Tally> of;
  std::map<std::string, int> same, left;
  std::map<std::string, std::string> words;  ///< of proposals that both leave unanswered, the first pair of each kind
  int other_state = 0, differ = 0, committed = 0, invalid = 0;
  std::string first_difference;
};

nlohmann::json as_json(const std::map<Kind, Tally>& tallies) {
  nlohmann::json out;
  for (const auto& [kind, tally] : tallies) {
    out[endorser::name_of(kind)] = {{"asked", tally.asked},
                                    {"endorsed", tally.endorsed},
                                    {"refused", tally.refused},
                                    {"unanswered", tally.unanswered},
                                    {"left_to_the_peer", tally.left_to_the_peer}};
  }
  return out;
}

/// Nonces of the transactions in the peer's blocks, with who has used each.
class UsedIds {
 public:
  struct One {
    std::size_t who = 0;
    std::string nonce;
  };
  UsedIds(fabric::Client& client, const std::vector<crypto::SigningIdentity>& people) {
    for (std::size_t i = 0; i < people.size(); ++i) people_[people[i].serialized] = i;
    blocks_ = client.blocks(
        0, {.on_block = [this](const fabric::Block& block, std::string_view) { take(block); }, .on_connection = {}});
  }
  std::size_t count() {
    const std::lock_guard lock(mutex_);
    return used_.size();
  }
  One at(std::size_t i) {
    const std::lock_guard lock(mutex_);
    return used_.at(i);
  }

 private:
  void take(const fabric::Block& block) {
    for (const fabric::Transaction& transaction : block.transactions) {
      common::Payload payload;
      common::SignatureHeader header;
      const auto who = people_.find(transaction.creator);
      if (who == people_.end() || !payload.ParseFromString(transaction.payload) ||
          !header.ParseFromString(payload.header().signature_header()))
        continue;
      const std::lock_guard lock(mutex_);
      used_.push_back({who->second, header.nonce()});
    }
  }

  std::map<std::string, std::size_t> people_;
  std::mutex mutex_;
  std::vector<One> used_;
  std::unique_ptr<fabric::Client::Stream> blocks_;
};

/// What did not go, in words.
std::string submit(std::vector<Person>& people, const std::vector<endorser::CallOf>& calls) {
  std::string problems;
  for (const endorser::CallOf& one : calls) {
    const fabric::Outcome outcome = people[one.who].client->submit_and_wait(one.call);
    if (outcome.kind != fabric::Outcome::Kind::committed) problems += one.call.function + ": " + outcome.message + "\n";
  }
  return problems;
}

/// Why neither of the two answered; a peer of Fabric says less than the endorser of who is no member.
std::string reason_in(const std::string& words) {
  for (const char* reason : {"duplicate transaction found", "expired", "access denied"})
    if (words.find(reason) != std::string::npos) return reason;
  return words;
}

class Asking {
 public:
  Asking(fabric::PeerQueries& own, fabric::PeerQueries& peer, Report& reported)
      : own_(own), peer_(peer), reported_(reported) {}

  /// Until both have taken the same blocks.
  void ask(const std::string& proposal, Kind kind, const std::string& function) {
    Tally& tally = reported_.of[kind];
    ++tally.asked;
    for (int tried = 0; tried < 200; ++tried) {
      if (tried > 0) {
        ++reported_.other_state;
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
      const auto mine = own_.propose(proposal), theirs = peer_.propose(proposal);
      // An id is used up at each of the two from its block on.
      if (kind == Kind::used_id && mine.ok() != theirs.ok()) continue;
      // At its start it waits until the peer has answered the same once.
      if (!mine && mine.error().message.find("has not yet answered as the peer") != std::string::npos) continue;
      const endorser::Comparison found =
          mine && theirs ? endorser::compare_answers(*mine, *theirs) : unanswered(mine, theirs, kind, function);
      if (found == endorser::Comparison::other_state) continue;
      if (found == endorser::Comparison::differ) return differ(function, mine, theirs);
      if (mine && theirs) {
        protos::ProposalResponse response;
        response.ParseFromString(*mine);
        ++(response.has_endorsement() ? tally.endorsed : tally.refused);
        ++reported_.same[function];
      }
      return;
    }
    differ(function, Error{"never of the same blocks"}, Error{"never of the same blocks"});
  }

 private:
  using Answer = Result<std::string>;

  endorser::Comparison unanswered(const Answer& mine, const Answer& theirs, Kind kind, const std::string& function) {
    Tally& tally = reported_.of[kind];
    if (mine) return endorser::Comparison::differ;
    if (theirs) {
      if (mine.error().message.find("a peer answers that") == std::string::npos) return endorser::Comparison::differ;
      ++tally.left_to_the_peer;
      ++reported_.left[function];
      return endorser::Comparison::same;
    }
    ++tally.unanswered;
    reported_.words.try_emplace(endorser::name_of(kind),
                                mine.error().message.substr(0, 200) + " | " + theirs.error().message.substr(0, 200));
    return reason_in(mine.error().message) == reason_in(theirs.error().message) ? endorser::Comparison::same
                                                                                : endorser::Comparison::differ;
  }

  void differ(const std::string& function, const Answer& mine, const Answer& theirs) {
    ++reported_.differ;
    if (!reported_.first_difference.empty()) return;
    const auto words = [](const Answer& answer) {
      protos::ProposalResponse response;
      if (!answer) return answer.error().message;
      response.ParseFromString(*answer);
      return std::to_string(response.response().status()) + " " + response.response().message() + "\n" +
             crypto::hex(response.payload());
    };
    reported_.first_difference = function + "\n" + words(mine) + "\n" + words(theirs);
  }

  fabric::PeerQueries &own_, &peer_;
  Report& reported_;
};

/// One whose certificate of the organisation has ended.
crypto::SigningIdentity expired_of(const std::string& key, const std::string& certificate, const std::string& msp_id) {
  const crypto::KeyAndCertificate ca{or_end(key, read_file(key)), or_end(certificate, read_file(certificate))};
  const auto made =
      or_end(certificate,
             crypto::issue(ca, {.common_name = "old", .organization = "", .unit = "client", .sans = {}, .days = 0}));
  msp::SerializedIdentity serialized;
  serialized.set_mspid(msp_id);
  serialized.set_id_bytes(made.certificate_pem);
  return {{msp_id, "CN=old"},
          serialized.SerializeAsString(),
          or_end(certificate, crypto::make_signer(crypto::Library::libcrypto, made.key_pem))};
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Asks an own endorser and its peer the same random proposals"};
  std::vector<std::string> configs;
  std::string endpoint, tls_ca, ca_key, ca_certificate;
  std::uint64_t seed = 1;
  int count = 500;
  bool again = false;
  app.add_option("--config", configs,
                 "TOML files with [ledger], in the order of endorser::Who; the peer asked is the first one's")
      ->required()
      ->expected(endorser::people_count);
  app.add_option("--endorser", endpoint, "HOST:PORT")->required();
  app.add_option("--tls-ca", tls_ca, "of the endorser's certificate")->required();
  app.add_option("--ca-key", ca_key, "of the first one's organisation")->required();
  app.add_option("--ca-certificate", ca_certificate)->required();
  app.add_option("--count", count);
  app.add_option("--seed", seed);
  app.add_flag("--again", again, "on a channel where it has run before");
  CLI11_PARSE(app, argc, argv);

  std::vector<Person> people;
  std::vector<crypto::IdentityName> names;
  std::vector<crypto::SigningIdentity> identities;
  for (const std::string& file : configs) {
    people.push_back({ledger_of(file), connect(file)});
    identities.push_back(people.back().config.identity);
    names.push_back(identities.back().name);
  }
  const crypto::SigningIdentity expired = expired_of(ca_key, ca_certificate, names.front().msp_id);
  const auto wrong = endorser::wrong_creators(identities[endorser::steady_host], identities[endorser::host]);
  fabric::ClientConfig at_endorser = people.front().config;
  at_endorser.endpoint = endpoint;
  at_endorser.tls_ca_file = tls_ca;
  const auto own = or_end(endpoint, fabric::PeerQueries::create(at_endorser));
  const auto peer = or_end(configs.front(), fabric::PeerQueries::create(people.front().config));
  std::string problems = again ? "" : submit(people, endorser::steady_calls(names));
  // Random calls of before have revoked people, and made what there was to make.
  if (const std::string refused = submit(people, endorser::usual_calls(names)); !again) problems += refused;
  if (!problems.empty()) {
    std::fprintf(stderr, "%s", problems.c_str());
    return 1;
  }
  UsedIds used(*people.front().client, identities);
  while (used.count() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  endorser::Calls calls(seed, names);
  Report reported;
  Asking asking(*own, *peer, reported);
  for (int i = 0; i < count; ++i) {
    // Random calls have revoked and evicted people, and deleted what there was.
    if (i % 50 == 49) (void)submit(people, endorser::usual_calls(names));
    const Kind kind = calls.next_kind();
    fabric::Call call = calls.any();
    std::size_t caller = calls.pick(3) == 0           ? calls.pick(people.size())
                         : call.function == "command" ? endorser::second_operator
                                                      : endorser::host;
    const crypto::SigningIdentity* who = nullptr;
    std::string nonce = crypto::random_bytes(24);
    switch (kind) {
      case Kind::command:
        call = calls.command();
        caller = endorser::steady_holder;
        break;
      case Kind::state:
        call = calls.state();
        caller = endorser::steady_host;
        break;
      case Kind::any:
        break;
      case Kind::used_id: {
        const UsedIds::One one = used.at(calls.pick(used.count()));
        caller = one.who;
        nonce = one.nonce;
        break;
      }
      case Kind::wrong_creator:
        call = calls.state();
        who = &wrong[calls.pick(wrong.size())];
        break;
      case Kind::expired_creator:
        call = calls.state();
        who = &expired;
        break;
    }
    const bool can_be_good = kind == Kind::command || kind == Kind::state || kind == Kind::any;
    if (who == nullptr) who = &identities[caller];
    const auto proposal = fabric::make_proposal(*who, people.front().config.where, call, realtime_ns(), nonce);
    asking.ask(proposal->signed_proposal, kind, call.function);
    if (calls.pick(4) != 0 || !can_be_good || call.function == "get" || call.function == "verify") continue;
    const fabric::Outcome outcome = people[caller].client->submit_and_wait(call);
    if (outcome.kind == fabric::Outcome::Kind::committed) ++reported.committed;
    if (outcome.kind == fabric::Outcome::Kind::invalidated) ++reported.invalid;
  }
  std::printf("%s\n", nlohmann::json{{"kinds", as_json(reported.of)},
                                     {"same", reported.same},
                                     {"left_to_the_peer", reported.left},
                                     {"words", reported.words},
                                     {"other_state", reported.other_state},
                                     {"differ", reported.differ},
                                     {"committed", reported.committed},
                                     {"invalid", reported.invalid},
                                     {"first_difference", reported.first_difference}}
                          .dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)
                          .c_str());
  return 0;
}
