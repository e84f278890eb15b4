// The endorser among kills, lags, forks, upgrades, wrong keys, expired and revoked certificates. Three claims, each
// counted from the chain and from what a stock peer answers, not from what the endorser says of itself:
//   1. no transaction is valid that a stock peer would have refused, or answered otherwise;
//   2. none is lost that was acknowledged, and each good call ends well;
//   3. none is invalid for a stale state of the endorser's twice in a row, if the client keeps to its rule.
// 20 seeds in every run, 1,000 with LEDGERLINE_LONG=1.
#include <gtest/gtest.h>

#include <array>
#include <map>

#include "common/fabric/tx/envelope.hpp"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"
#include "tests/unit/campaign.hpp"
#include "tests/unit/chaincode/endorser/machine.hpp"
#include "tests/unit/chaincode/node/core/fake_network.hpp"

namespace ledgerline::endorser {
namespace {

using node::Code;
using node::Reply;

constexpr TimeNs step_ns = 33 * ns_per_ms, rest_ns = 200 * ns_per_ms, day_ns = 86'400 * ns_per_s;
constexpr int steps = 150, drain = 40;

/// One who calls and waits for the end of each call before the next, by the rule of fabric::Pipeline: the endorser is
/// asked first; where it is not there, or its transaction was invalid, it rests and the peer is asked.
struct Client {
  const Member* who = nullptr;
  bool grants = false;  ///< an administrator, whose calls read what they write; else a host with its stream
  std::string drone;
  std::string wanted, acknowledged;  ///< what is to be written, and what was
  std::string tx_id;                 ///< in flight; empty: none
  TimeNs rest_until_ns = 0;
  int stale_in_a_row = 0;
};

/// What was ordered.
struct Ordered {
  std::string payload;                ///< ProposalResponsePayload that was endorsed
  std::optional<std::string> oracle;  ///< what the stock peer would have endorsed at that moment
  Client* client = nullptr;           ///< nullptr: somebody who should not
  bool by_endorser = false, stale = false, own_expired = false;
};

struct Counts {
  int kills = 0, lags = 0, cuts = 0, forks = 0, upgrades = 0, false_keys = 0, expiries = 0, revocations = 0, bad = 0;
  int faults() const { return kills + lags + cuts + forks + upgrades + false_keys + expiries + revocations; }
  int by_endorser = 0, by_peer = 0, stale_invalid = 0, of_revoked = 0;
};

std::string payload_of(const Reply& reply) {
  protos::ProposalResponse response;
  response.ParseFromString(reply.bytes);
  const bool endorsed = reply.code == Code::ok && response.response().status() < 400 && response.has_endorsement();
  return endorsed ? response.payload() : std::string();
}

class World {
 public:
  explicit World(std::uint64_t seed, Counts& counts) : counts_(counts), random_(seed) {
    for (std::size_t i = 0; i < clients_.size(); ++i) {
      clients_[i].who = &people().hosts[i];
      clients_[i].drone = "tello" + std::to_string(i + 1);
      submit_by_all(people().admin, "enroll", node::enroll_call(clients_[i].who->identity.name, {clients_[i].drone}));
      submit_by_all(*clients_[i].who, "set", sample(clients_[i].drone, "first"));
    }
    submit_by_all(people().admin, "grant", node::grant_call("Org2MSP", {clients_[1].drone}));
    clients_[1].who = &people().admin;
    clients_[1].grants = true;
    endorser_.start(people().endorsers[0]);
  }

  void run() {
    for (int i = 0; i < steps + drain && !::testing::Test::HasFailure(); ++i) {
      calm_ = i >= steps;
      step();
    }
    check_nothing_is_lost();
  }

 private:
  bool one_in(std::uint64_t n) { return random_.next() % n == 0; }
  int between(int low, int high) {
    return low + static_cast<int>(random_.next() % static_cast<std::uint64_t>(high - low + 1));
  }

  fabric::Proposal propose(const Member& who, const std::string& function, const std::string& arg,
                           const fabric::ChannelAndContract& where = {}) {
    std::string nonce = "nonce " + std::to_string(++nonces_);
    nonce.resize(24, '.');
    return *fabric::make_proposal(who.identity, where, {function, {arg}}, now_.real_ns, nonce);
  }
  static std::string sample(const std::string& drone, const std::string& data) {
    SetCall call;
    call.ParseFromString(node::note(drone + "/a", data));
    call.mutable_assets(0)->set_msg_type(data);  // in the clear where it is shown
    call.set_stream(true);
    return call.SerializeAsString();
  }
  std::string grant(const std::string& drone) {
    GrantCall call;
    call.ParseFromString(node::grant_call("Org2MSP", {drone}));
    call.mutable_grant()->set_max_priority(static_cast<std::uint32_t>(values_ % 10));
    return call.SerializeAsString();
  }
  void submit_by_all(const Member& who, const std::string& function, const std::string& arg) {
    const Reply reply = channel_.peer.endorse(propose(who, function, arg).signed_proposal, now_);
    ASSERT_EQ(reply.code, Code::ok) << reply.detail;
    ASSERT_EQ(channel_.cut({*fabric::sign_envelope(who.identity, reply.bytes)}), std::vector<int>{protos::VALID});
  }

  void step() {
    now_.monotonic_ns += step_ns;
    now_.real_ns += step_ns;
    if (!calm_) faults();
    if (restart_in_ > 0 && --restart_in_ == 0) endorser_.start(*next_identity_);
    if (endorser_.failed() && restart_in_ == 0) restart_with(*endorser_.identity());
    if (offline_ > 0) --offline_;
    if (lag_for_ > 0) --lag_for_;
    if (approve_in_ > 0 && --approve_in_ == 0) channel_.peer.approve();
    endorser_.set_connected(offline_ == 0);
    endorser_.step(lag_for_ > 0 ? lag_ : 0, now_);
    for (Client& client : clients_) call(client);
    if (!calm_ && one_in(3)) misbehave();
    if (!waiting_.empty() && (calm_ || !one_in(3))) commit();
  }

  void restart_with(const Member& identity) {
    endorser_.kill();
    next_identity_ = &identity;
    restart_in_ = between(1, 6);
  }
  const Member& good_identity() { return people().endorsers[good_]; }

  void faults() {
    if (one_in(40)) {
      ++counts_.kills;
      restart_with(good_identity());
    }
    if (one_in(12)) {
      ++counts_.lags;
      lag_ = static_cast<std::uint64_t>(between(1, 5));
      lag_for_ = between(1, 12);
    }
    if (one_in(50)) {
      ++counts_.cuts;
      offline_ = between(1, 8);
    }
    if (one_in(40)) show_a_lie();
    if (one_in(40)) {
      ++counts_.upgrades;
      channel_.define();
      if (one_in(2)) channel_.peer.approve();
      approve_in_ = channel_.peer.approves() ? 0 : between(1, 15);
    }
    if (one_in(100)) {
      ++counts_.false_keys;
      static const Member mixed{{people().endorsers[0].identity.name, people().endorsers[0].identity.serialized,
                                 people().hosts[0].identity.signer},
                                ""};
      restart_with(one_in(2) ? mixed : people().false_endorser);
    }
    if (one_in(120) && !aged_ && aging_in_ == 0) {
      ++counts_.expiries;
      restart_with(people().brief_endorser);
      aging_in_ = between(8, 20);
    }
    if (aging_in_ > 0 && --aging_in_ == 0) {
      aged_ = true;
      now_.real_ns += 3 * day_ns;
    }
    if (one_in(80) && good_ + 1 < people().endorsers.size()) {
      ++counts_.revocations;
      channel_.revoke(people().first, good_identity());
      ++good_;  // its operator gives it the next one later
      if (one_in(2)) restart_with(good_identity());
    }
    if (one_in(80) && !left_) {
      ++counts_.revocations;
      left_ = true;
      channel_.revoke(people().first, people().hosts.back());
    }
  }

  void show_a_lie() {
    if (!endorser_.runs() || endorser_.failed() || offline_ > 0 || endorser_.height() < 3) return;
    ++counts_.forks;
    const std::uint64_t due = endorser_.height();
    common::Block last;
    last.ParseFromString(channel_.blocks[due - 1]);
    const std::string hash = fabric::header_hash(last.header());
    bool taken = false;
    switch (random_.next() % 4) {
      case 0:
        if (due + 1 >= channel_.blocks.size()) return;
        taken = endorser_.show(channel_.blocks[due + 1]);
        break;
      case 1:
        taken = endorser_.show(channel_.blocks[due - 1]);
        break;
      case 2:
        if (due >= channel_.blocks.size()) return;
        taken = endorser_.show(channel_.other_block(due, std::string(32, 'f'), people().orderer));
        break;
      default:
        if (due >= channel_.blocks.size()) return;
        taken = endorser_.show(channel_.other_block(due, hash, people().forger));
    }
    EXPECT_FALSE(taken) << "it took what is no next block of the channel";
  }

  /// By whom it was answered, and what.
  std::pair<Reply, bool> ask(Client& client, const fabric::Proposal& proposal) {
    if (now_.monotonic_ns >= client.rest_until_ns) {
      Reply reply = endorser_.process_proposal(proposal.signed_proposal, now_);
      if (reply.code != Code::unavailable) return {std::move(reply), true};
      client.rest_until_ns = now_.monotonic_ns + rest_ns;
    }
    return {channel_.peer.process_proposal(proposal.signed_proposal, now_), false};
  }

  void call(Client& client) {
    const bool leaves = left_ && client.who == &people().hosts.back();
    if (!client.tx_id.empty() || (!leaves && calm_ && !client.wanted.empty() && client.wanted == client.acknowledged))
      return;
    if (leaves && calm_) return;
    if (client.wanted == client.acknowledged) client.wanted = "value/" + std::to_string(++values_) + "/";
    const auto proposal = client.grants ? propose(*client.who, "grant", grant(client.drone))
                                        : propose(*client.who, "set", sample(client.drone, client.wanted));
    const auto [reply, by_endorser] = ask(client, proposal);
    if (payload_of(reply).empty()) {
      if (!by_endorser) client.stale_in_a_row = 0;  // that call has had another end
      if (leaves || !channel_.peer.approves()) return;
      // One that refuses a good call because of an older state is asked once more; none may refuse it for ever.
      EXPECT_TRUE(by_endorser) << "the stock peer refuses: " << reply.message;
      client.rest_until_ns = now_.monotonic_ns + rest_ns;
      return;
    }
    order(*client.who, proposal, reply, by_endorser, &client);
    client.tx_id = proposal.tx_id;
  }

  void order(const Member& who, const fabric::Proposal& proposal, const Reply& reply, bool by_endorser,
             Client* client) {
    const auto envelope = fabric::assemble(proposal, {reply.bytes});
    ASSERT_TRUE(envelope.ok()) << envelope.error().message;
    Ordered one;
    one.payload = payload_of(reply);
    const std::string oracle = payload_of(channel_.peer.process_proposal(proposal.signed_proposal, now_));
    if (!oracle.empty()) one.oracle = oracle;
    one.client = client;
    one.by_endorser = by_endorser;
    if (by_endorser) {
      one.stale = endorser_.height() < channel_.peer.height();
      one.own_expired = endorser_.identity() == &people().brief_endorser && aged_;
      ++counts_.by_endorser;
    } else {
      ++counts_.by_peer;
    }
    EXPECT_FALSE(one.own_expired) << "it signs with a certificate that has expired";
    EXPECT_TRUE(one.oracle || !by_endorser || one.stale) << "it signs what a peer of the same blocks refuses";
    ordered_.emplace(proposal.tx_id, std::move(one));
    waiting_.push_back({proposal.tx_id, *fabric::sign_envelope(who.identity, *envelope)});
    sent_.push_back(proposal);
  }

  /// Proposals that no peer answers well, some of them from people who would have the transaction ordered nevertheless.
  void misbehave() {
    ++counts_.bad;
    const std::string good = sample("tello1", "bad");
    const Member* who = &people().hosts[0];
    fabric::Proposal proposal;
    bool again = false;
    const auto as = [&](const Member& one, const std::string& function = "set", const std::string& arg = "") {
      who = &one;
      proposal = propose(one, function, arg.empty() ? good : arg);
    };
    switch (random_.next() % 10) {
      case 0:
        as(people().outsider);
        break;
      case 1:
        as(people().expired);
        break;
      case 2:
        as(people().foreigner);
        break;
      case 3:
        as(people().hosts[1]);
        break;
      case 4:
        if (sent_.empty()) return;
        proposal = sent_[random_.next() % sent_.size()];
        again = true;  // its id is used up, or soon will be
        break;
      case 5: {
        as(people().hosts[0]);
        protos::SignedProposal outer;
        outer.ParseFromString(proposal.signed_proposal);
        outer.set_signature(*people().hosts[1].identity.signer->sign(outer.proposal_bytes()));
        proposal.signed_proposal = outer.SerializeAsString();
        break;
      }
      case 6:
        proposal = propose(*who, "set", good, {"other", "ledgerline"});
        break;
      case 7:
        proposal = propose(*who, "set", good, {"teleop", "other"});
        break;
      case 8:
        as(people().hosts[0], "set", "{");
        break;
      default:
        as(people().hosts[0], "fly");
        break;
    }
    const Reply own = endorser_.process_proposal(proposal.signed_proposal, now_);
    if (payload_of(own).empty()) return;
    const bool used = channel_.peer.state().find_tx(proposal.tx_id).has_value();
    EXPECT_TRUE((again && !used) || endorser_.height() < channel_.peer.height()) << "it signs what no peer would";
    if (again) return;  // who has its transaction ordered already
    order(*who, proposal, own, true, nullptr);
  }

  void commit() {
    std::vector<std::string> envelopes;
    for (const auto& [tx_id, envelope] : waiting_) envelopes.push_back(envelope);
    const std::vector<int> codes = channel_.cut(envelopes);
    for (std::size_t i = 0; i < codes.size(); ++i) end(waiting_[i].first, codes[i]);
    waiting_.clear();
  }

  void end(const std::string& tx_id, int code) {
    const Ordered& one = ordered_.at(tx_id);
    if (code == protos::VALID) {
      EXPECT_TRUE(one.oracle) << "valid, and a stock peer would have refused it";
      EXPECT_TRUE(!one.oracle || *one.oracle == one.payload) << "valid, and a stock peer would have answered otherwise";
      EXPECT_NE(one.client, nullptr) << "valid, and nobody may call that";
    }
    if (one.client == nullptr) return;
    if (code == protos::BAD_CREATOR_SIGNATURE) ++counts_.of_revoked;
    Client& client = *one.client;
    client.tx_id.clear();
    const bool stale = code == protos::MVCC_READ_CONFLICT && one.by_endorser && one.stale;
    if (stale) ++counts_.stale_invalid;
    client.stale_in_a_row = stale ? client.stale_in_a_row + 1 : 0;
    EXPECT_LE(client.stale_in_a_row, 1) << "invalid for a stale state twice in a row";
    if (code == protos::VALID) client.acknowledged = client.wanted;
    if (code != protos::VALID && one.by_endorser) client.rest_until_ns = now_.monotonic_ns + rest_ns;
  }

  void check_nothing_is_lost() {
    // Counted from the chain alone: each id is valid at most once.
    std::map<std::string, int> valid;
    for (const std::string& raw : channel_.blocks) {
      const auto block = fabric::decode_block(raw);
      for (const fabric::Transaction& tx : block->transactions) {
        if (tx.code == protos::VALID && !tx.config) ++valid[tx.tx_id];
      }
    }
    for (const auto& [tx_id, times] : valid) EXPECT_EQ(times, 1) << tx_id;
    // One that starts from nothing knows all that was acknowledged.
    Machine second(channel_, random_);
    second.start(good_identity());
    second.set_connected(true);
    second.step(0, now_);
    EXPECT_FALSE(second.failed()) << second.why();
    channel_.peer.approve();
    for (Client& client : clients_) {
      const bool leaves = left_ && client.who == &people().hosts.back();
      if (!leaves) {
        EXPECT_EQ(client.wanted, client.acknowledged) << client.drone << ": a good call has no good end";
      }
      const auto question =
          propose(people().hosts[0], "get", client.grants ? "control/" + client.drone : client.drone + "/a");
      (void)second.process_proposal(question.signed_proposal, now_);  // first it agrees with the peer
      second.step(0, now_);
      const Reply own = second.process_proposal(question.signed_proposal, now_);
      const Reply peers = channel_.peer.process_proposal(question.signed_proposal, now_);
      ASSERT_EQ(own.code, Code::ok) << own.message;
      EXPECT_EQ(compare_answers(own.bytes, peers.bytes), Comparison::same);
      protos::ProposalResponse response;
      response.ParseFromString(own.bytes);
      if (!client.acknowledged.empty() && !client.grants) {
        EXPECT_NE(response.response().payload().find(client.acknowledged), std::string::npos)
            << client.drone << ": what was acknowledged is gone";
      }
    }
  }

  Counts& counts_;
  Random random_;
  node::Now now_{ns_per_s, realtime_ns() + 2 * day_ns};
  Channel channel_;
  Machine endorser_{channel_, random_};
  std::array<Client, 3> clients_;
  std::map<std::string, Ordered> ordered_;
  std::vector<std::pair<std::string, std::string>> waiting_;
  std::vector<fabric::Proposal> sent_;
  const Member* next_identity_ = nullptr;
  std::size_t good_ = 0;
  bool calm_ = false, left_ = false, aged_ = false;
  int restart_in_ = 0, offline_ = 0, lag_for_ = 0, approve_in_ = 0, aging_in_ = 0;
  std::uint64_t lag_ = 0;
  int nonces_ = 0, values_ = 0;
};

TEST(EndorserCampaign, NoFaultLetsAWrongTransactionInOrAGoodOneOut) {
  Counts all;
  const int count = seeds(slow ? 3 : 20, 1000);
  for (int seed = 1; seed <= count; ++seed) {
    World(static_cast<std::uint64_t>(seed), all).run();
    ASSERT_FALSE(HasFailure()) << "seed " << seed;
  }
  std::printf(
      "%d seeds: %d faults (%d kills, %d lags, %d cuts, %d forks, %d upgrades, %d false keys, %d expiries, %d "
      "revocations), %d bad proposals; transactions: %d by the endorser, %d by the peer, %d invalid for a stale state, "
      "%d of a revoked creator\n",
      count, all.faults(), all.kills, all.lags, all.cuts, all.forks, all.upgrades, all.false_keys, all.expiries,
      all.revocations, all.bad, all.by_endorser, all.by_peer, all.stale_invalid, all.of_revoked);
  if (slow) return;
  // It has seen what it is for.
  EXPECT_GT(all.by_endorser, all.by_peer / 8);
  for (const int kind : {all.kills, all.lags, all.cuts, all.forks, all.upgrades, all.false_keys, all.expiries,
                         all.revocations, all.bad, all.stale_invalid, all.of_revoked})
    EXPECT_GT(kind, 0);
}

}  // namespace
}  // namespace ledgerline::endorser
