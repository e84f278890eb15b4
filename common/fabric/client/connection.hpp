#pragma once
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <memory>
#include <string>

#include "common/base/random.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/client/commits.hpp"

/// What the pipeline and the streams share. Inside common/fabric alone: it brings in gRPC.
namespace ledgerline::fabric {

struct Connection {
  ClientConfig config;
  std::vector<std::shared_ptr<grpc::Channel>> peers;  ///< the own one first, then those that stand in
  /// The same peers, for streams alone: where a stream and calls share a connection, whichever thread wakes for its
  /// bytes reads them, and must wake the other.
  std::vector<std::shared_ptr<grpc::Channel>> stream_peers;
  std::vector<std::shared_ptr<grpc::Channel>> orderers;
  std::shared_ptr<Commits> commits = std::make_shared<Commits>();

  /// Index of the peer to ask now: our own, or, while it is not reached, the first stand-in that is.
  std::size_t peer() const;
};
Result<std::shared_ptr<const Connection>> make_connection(ClientConfig config);

/// The ledger was not reached, or is too busy; asking again may help.
bool may_pass(const grpc::Status& status);

/// What the peers said (gateway.ErrorDetail), or gRPC's own message where they said nothing.
std::string describe(const grpc::Status& status);

/// Exponential back-off between attempts: doubles up to `longest`, with jitter (half to whole of it), so that the many
/// clients of a ledger that comes back do not all ask at once.
class Backoff {
 public:
  Backoff(std::chrono::milliseconds first, std::chrono::milliseconds longest);
  std::chrono::milliseconds next();
  void reset() { wait_ = first_; }

 private:
  std::chrono::milliseconds first_, longest_, wait_;
  Random random_;
};

/// Attempts of one call that is safe to repeat; with back-off they take well below half a second.
inline constexpr int max_attempts = 5;
inline constexpr std::chrono::milliseconds first_retry{20}, max_retry{200};

}  // namespace ledgerline::fabric
