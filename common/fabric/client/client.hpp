#pragma once
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/blocks/checkpoint.hpp"
#include "common/fabric/calls/outcome.hpp"
#include "common/fabric/tx/transaction.hpp"

/// Client of a Fabric gateway, its peer's Endorser and Deliver services, and orderers. Nothing here knows which ledger
/// it talks to. An example is example.cpp beside this file; for use outside this tree see docs/library.md.
namespace ledgerline::fabric {

class Connection;
class OwnEndorser;
struct ChannelConfig;

/// The TLS pairs of a program's clients that were renewed while it runs, as they were checked: what lies in the files
/// may be something else by then. Any thread.
class TlsPairsInUse {
 public:
  struct Pair {
    std::string certificate_pem, key_pem;
  };

  /// Of the pair whose certificate is in that file. Connections are recreated after it.
  void renew(const std::string& certificate_file, Pair pair) {
    const std::lock_guard lock(mutex_);
    pairs_[certificate_file] = std::move(pair);
    ++renewals_;
  }
  /// None: it was not renewed, so its files count.
  std::optional<Pair> of(const std::string& certificate_file) const {
    const std::lock_guard lock(mutex_);
    const auto found = pairs_.find(certificate_file);
    return found == pairs_.end() ? std::nullopt : std::optional(found->second);
  }
  std::uint64_t renewals() const {
    const std::lock_guard lock(mutex_);
    return renewals_;
  }

 private:
  mutable std::mutex mutex_;
  std::map<std::string, Pair> pairs_;  ///< at most one for each pair that a config names
  std::uint64_t renewals_ = 0;
};

struct ClientConfig {
  std::string endpoint;     ///< "127.0.0.1:7051"
  std::string tls_ca_file;  ///< PEM of the CAs that signed the server's certificate, root or intermediate
  std::string server_name;  ///< empty: the endpoint's host must be in the certificate
  /// The own certificate of TLS, for servers that want one (clientAuthRequired): PEM, with its intermediates behind it.
  struct TlsPair {
    std::string certificate_file{}, key_file{};
  };
  TlsPair tls_pair;
  /// Pairs that are renewed while clients run: after each renewal connections are recreated. None: they never are, and
  /// the files count as they are when a client is created.
  std::shared_ptr<TlsPairsInUse> tls_in_use{};
  struct Server {
    std::string endpoint;
    std::string tls_ca_file;
    std::string server_name{};  ///< as above
    TlsPair tls_pair{};         ///< none: the client's own
  };
  /// Orderers, for the direct path: calls are endorsed by the peer at `endpoint` itself and sent to an orderer, which
  /// saves the gateway's two steps. Empty: everything through the gateway.
  std::vector<Server> orderers;
  /// Peers that endorse for their organisations, for the direct path; see `endorsement_need`. Those of organisations
  /// that are not here are found by the gateway.
  struct Endorser {
    std::string msp_id, endpoint, tls_ca_file, server_name{};
    TlsPair tls_pair{};
  };
  std::vector<Endorser> endorsers;
  /// Of the own organisation and in this process: asked before those of `endorsers`, on the client's own thread. The
  /// first block stream that a client with it begins feeds it, too. Needs `orderers`. None: there is none.
  std::shared_ptr<OwnEndorser> own_endorser{};
  /// Peers that stand in while the one at `endpoint` is not reached, for everything; the first that is reached.
  std::vector<Server> other_peers;
  /// A common.Block with a configuration of the channel, the trust anchor: blocks must then be signed by the orderers
  /// that it names, or that a later configuration names (BlockValidator). Empty: the peer's blocks are accepted
  /// unverified.
  std::string config_block;
  crypto::Library verifier = crypto::Library::libcrypto;  ///< of those signatures
  /// Whose blocks blocks() hands over. Beside the peer's alone it needs `orderers`; `ordered` needs config_block, too.
  BlockSource blocks = BlockSource::peer;
  ChannelAndContract where;
  ContractRules contract_rules;
  crypto::SigningIdentity identity;
  crypto::IdentitySource identity_source{};  ///< that it was loaded from, for who renews it
  std::size_t max_in_flight = 64;            ///< further submits are refused at once with Outcome::Kind::overloaded
  bool timeouts_of_channel = false;          ///< limits of time grow by what the channel's blocks take (config.hpp)
  std::chrono::milliseconds deadline{5000};  ///< of one call, from submit() or evaluate() to its end
  std::chrono::milliseconds endorse_timeout{300};  ///< with peers that others do not need to wait for
};

/// All methods may be called from any thread. Callbacks come on a thread of the client: they hand over and return.
/// Destruction cancels what is in flight; its callbacks still come, as unavailable, before the destructor returns (so
/// it must not happen within a callback). The ledger orders one client's transactions as they were submitted:
/// common/fabric/client/pipeline.hpp says how. What must not wait behind them has a client of its own.
class Client {
 public:
  /// Does not connect yet; a bad identity, CA file or config block is an error here.
  static Result<std::unique_ptr<Client>> create(ClientConfig config);
  virtual ~Client() = default;

  /// Endorse -> submit -> commit status, as a pipeline that never blocks the caller. `done` comes exactly once.
  virtual void submit(Call call, std::function<void(Outcome)> done) = 0;
  /// The same, waiting. For tools and start-up.
  virtual Outcome submit_and_wait(Call call) = 0;
  /// Asks without writing; waits for the answer, at most the deadline. An error has the contract's words, or says why
  /// the ledger was not reached.
  virtual Result<std::string> evaluate(Call call) = 0;
  /// The same, asked of the peer at `endpoint` itself, past any gateway: its own word, of an organisation that need not
  /// be the caller's.
  virtual Result<std::string> evaluate_at_peer(Call call) = 0;
  /// Whether the gateway finds endorsements enough for the call now, or that of the organisation which the call's
  /// `need` names; nothing is submitted. Waits as evaluate().
  virtual Status endorsable(Call call) = 0;

  /// A running stream; destruction ends it and returns after its last callback (so not from within one). It may outlive
  /// the client.
  class Stream {
   public:
    virtual ~Stream() = default;
  };
  struct StreamHandlers {
    /// In order, no gap, no duplicate, across reconnects.
    std::function<void(const Block&, std::string_view raw)> on_block;
    std::function<void(bool connected, const std::string& why)> on_connection;
    /// Transactions that are not what their flags say (Transaction::problem), in words: block, transaction, why, and
    /// how many there were. Reported at once, then at most once a minute; on_block reports all. Beside that limit: how
    /// many transactions of a block that was taken as it was ordered proved invalid, and, once, that the peer does not
    /// say whose endorsement the contract needs.
    std::function<void(const std::string& what)> on_unverified = {};
    /// A stream contradicts what is known: a fork, a block that the orderers have not signed, peer and orderers that
    /// deliver two chains or verdicts. In words, at each attempt. What was refused was not handed over; a block that
    /// was taken as it was ordered was before.
    std::function<void(const std::string& what)> on_contradiction = {};
    /// A block that was refused, or that either stream brings behind a contradiction, with none of its flags: for who
    /// acts on a signature alone, as on a stop. It may come again, out of order, or be of no chain at all.
    std::function<void(const Block&)> on_refused = {};
    /// A block that was handed over as an orderer delivered it (Block::confirmed) has now come from the peer, too.
    struct Confirmed {
      std::uint64_t number = 0;
      std::string hash;                         ///< block_header_hash
      TimeNs ordered_ns = 0, confirmed_ns = 0;  ///< when either was taken, in this order, CLOCK_MONOTONIC
    };
    std::function<void(const Confirmed&)> on_confirmed = {};
    /// Whether an orderer's stream is there, where one is read, or withholds what the peer has delivered; the peer's
    /// stream goes on without it.
    std::function<void(bool connected, const std::string& why)> on_orderers = {};
    /// Of blocks_behind(): how the peer's chain goes on; once, before the first block.
    std::function<void(const Continuation&)> on_continued = {};
  };
  /// Blocks from number `start` (nullopt: from the next new one on). Reconnects with back-off and jitter, for ever, and
  /// resumes behind the last block handed over. With config_block each transaction is validated by the rule of Fabric's
  /// peers, as far as the blocks of this stream show what it rests on (BlockIntake). One that cannot be trusted is
  /// left out alone, see decode_block. A block that breaks the chain is reported through on_connection and the stream
  /// starts again at the last good one. With ClientConfig::blocks `ordered` a second stream brings an orderer's blocks;
  /// once the two differ, nothing more is handed over, and on_connection says so. A block is then handed over as soon
  /// as an orderer delivers it, where our own validation needs no flag of the peer (its flags are our verdicts then),
  /// and on_confirmed says when the peer delivered the same; at most BlockIntake::max_unconfirmed blocks ahead of the
  /// peer. Calls that are reported_by_block end with the block, too.
  virtual std::unique_ptr<Stream> blocks(std::optional<std::uint64_t> start, StreamHandlers handlers) = 0;
  /// The same for who starts again: blocks from behind a checkpoint on, or, after a longer absence than it allows, from
  /// the next new one on, whose predecessor then counts by its orderers' signatures (needs config_block, or is the
  /// peer's word). A chain that ends before the checkpoint, or has another block in its place, is refused:
  /// on_connection says so, and the peer is asked again.
  virtual std::unique_ptr<Stream> blocks_behind(LastVerified verified, StreamHandlers handlers) = 0;
  /// Contract events through the gateway's ChaincodeEvents, from block `start` on (nullopt: from the next new one on),
  /// behind transaction `after_tx_id` of that block where one is named: the last event handled is a checkpoint.
  /// Reconnects like blocks(), without loss or duplicate.
  struct Event {
    std::uint64_t block = 0;
    std::string tx_id, name, payload;
  };
  virtual std::unique_ptr<Stream> events(std::optional<std::uint64_t> start, std::function<void(const Event&)> on_event,
                                         std::function<void(bool, const std::string&)> on_connection,
                                         std::string after_tx_id = {}) = 0;
};

/// An endorser of the own organisation within this process (ClientConfig::own_endorser). Any thread.
class OwnEndorser {
 public:
  virtual ~OwnEndorser() = default;

  struct Answer {
    Result<std::string> response;  ///< protos.ProposalResponse
    bool elsewhere = false;        ///< there is none, but another endorser may answer
  };
  /// To a protos.SignedProposal. Waits for nobody outside this process, but at most 0.2 s for the first under a
  /// definition of the contract.
  virtual Answer endorse(const std::string& signed_proposal) = 0;

  /// The handlers of a block stream that the process reads anyway, so that the blocks need not be read for the endorser
  /// alone. It takes a block after the given handler has had it.
  virtual Client::StreamHandlers fed_by(Client::StreamHandlers handlers) = 0;
};

/// What a program queries of the peer of its config directly, waiting at most the config's deadline: not a call of its
/// own, but about the peer. Any thread.
class PeerQueries {
 public:
  static Result<std::unique_ptr<PeerQueries>> create(ClientConfig config);

  /// The peer's protos.ProposalResponse to somebody's protos.SignedProposal.
  Result<std::string> propose(std::string_view signed_proposal);
  /// How many blocks the peer has of the channel.
  Result<std::uint64_t> height();
  /// A serialized common.Block of the channel.
  Result<std::string> block(std::uint64_t number);
  /// The channel's newest config block, as the peer reports it: a common.Block for read_channel_config. Nobody has
  /// validated it.
  Result<std::string> config_block();
  /// That, read.
  Result<ChannelConfig> channel_config();
  /// The payload of a peer's answer to a call of one of its own contracts ("qscc", "cscc", "_lifecycle"), with a
  /// channel or without (""); an error is the peer's word.
  Result<std::string> query(const ChannelAndContract& where, const Call& call);

 private:
  explicit PeerQueries(std::shared_ptr<const Connection> connection) : connection_(std::move(connection)) {}

  std::shared_ptr<const Connection> connection_;
};

}  // namespace ledgerline::fabric
