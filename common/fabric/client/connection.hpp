#pragma once
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_set>
#include <vector>

#include "common/base/random.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/client/client.hpp"
#include "common/rt/retry.hpp"
#include "peer/proposal_response.pb.h"

/// What the pipeline and the streams share. Inside common/fabric alone: it brings in gRPC.
namespace ledgerline::fabric {

/// Connections with one set of TLS pairs: certificates and what is said of them to Deliver belong together.
struct GrpcChannels {
  std::vector<std::shared_ptr<grpc::Channel>> peers;  ///< the own one first, then those that stand in
  /// The same peers, for streams alone: where a stream and calls share a connection, whichever thread wakes for its
  /// bytes reads them, and must wake the other.
  std::vector<std::shared_ptr<grpc::Channel>> stream_peers;
  /// Of the certificates that those are shown, for Deliver; empty: none is.
  std::vector<std::string> peer_tls_hashes, orderer_tls_hashes;
  std::vector<std::shared_ptr<grpc::Channel>> orderers;
  std::vector<std::shared_ptr<grpc::Channel>> stream_orderers;  ///< likewise; none where their blocks are not read
  std::vector<std::shared_ptr<grpc::Channel>> endorsers;        ///< as in the config; the own peer's is its own
};

/// Between a client's block streams, which see transactions committed, and its pipeline, which waits for some of them.
/// Any thread; the streams may outlive the pipeline.
class Commits {
 public:
  struct Observation {
    std::string tx_id;
    std::uint64_t block = 0;
    int code = 0;
  };

  // The pipeline's side.

  /// `wake` comes on a stream's thread when there is something to pop_update(); an empty one ends that.
  void on_update(std::function<void()> wake);
  /// Whether a stream is there that would see it. False: ask the peer.
  bool await(const std::string& tx_id);
  void forget(const std::string& tx_id);
  /// What was seen of the awaited; each once. `lost`: no stream is left, so what is still awaited has to be asked for.
  struct Update {
    std::vector<Observation> seen;
    bool lost = false;
  };
  Update pop_update();

  // A stream's side.

  void connected(bool is);
  void block(const Block& block);

 private:
  std::mutex mutex_;  ///< held while `wake` is called
  std::function<void()> wake_;
  std::unordered_set<std::string> awaited_;
  Update update_;
  int streams_ = 0;
};

class Connection {
 public:
  Connection(ClientConfig settings, std::shared_ptr<const GrpcChannels> channels);

  const ClientConfig config;  ///< its identity has `in_use`
  std::shared_ptr<Commits> commits = std::make_shared<Commits>();

  /// As they are now: a caller that needs two things of them takes them once. After ClientConfig::tls_in_use has a
  /// renewed pair they are recreated; a caller that still holds the old ones continues to use them. Any thread.
  std::shared_ptr<const GrpcChannels> channels() const;
  /// Whom to sign as now; what has begun as one goes on as that one. Any thread.
  std::shared_ptr<const crypto::SigningIdentity> signing() const { return config.identity.in_use->now(); }

  /// Index of the peer to ask now: our own, or, while it is not reached, the first stand-in that is.
  std::size_t peer() const;
  /// The endpoint of the peer with that index.
  const std::string& endpoint(std::size_t peer) const;
  /// Indices of the endorsers to ask now, one of each organisation: the first that is reached and does not rest.
  std::vector<std::size_t> endorsers_now(const std::function<bool(std::size_t)>& rests = {}) const;

 private:
  mutable std::mutex mutex_;
  mutable std::shared_ptr<const GrpcChannels> channels_;
  mutable std::uint64_t renewals_ = 0;  ///< of the config's, when channels_ was made
  mutable TimeNs renew_from_ns_ = 0;    ///< after an attempt that failed
  mutable std::string problem_;         ///< why it did, as reported last
};
Result<std::shared_ptr<const Connection>> make_connection(ClientConfig config);

/// The ledger was not reached, or is too busy; asking again may help.
bool may_pass(const grpc::Status& status);
/// That, or no answer came: nobody has refused anything.
bool is_away(const grpc::Status& status);

/// What the peers said (gateway.ErrorDetail), or gRPC's own message where they said nothing; of a server that was not
/// reached, what may be wrong with the config. Printable; the caller names the server.
std::string describe(const grpc::Status& status);

/// The answer of the peer at `endpoint` to somebody's protos.SignedProposal, waiting at most `deadline`.
Result<protos::ProposalResponse> query_peer(const std::string& endpoint, const std::shared_ptr<grpc::Channel>& peer,
                                            std::string_view signed_proposal, std::chrono::milliseconds deadline);

/// For a BackOff's jitter: another in each client of a process.
std::uint64_t random_seed();

/// Attempts of one call that is safe to repeat; with back-off they take well below half a second.
class Attempts {
 public:
  using Time = std::chrono::system_clock::time_point;
  /// One has ended so: when the next may begin; none: no further one.
  std::optional<Time> next(const grpc::Status& status, Time deadline, Random& random);

 private:
  static constexpr int max_made = 5;
  int made_ = 0;
  BackOff back_off_{20 * ns_per_ms, 200 * ns_per_ms};
};

}  // namespace ledgerline::fabric
