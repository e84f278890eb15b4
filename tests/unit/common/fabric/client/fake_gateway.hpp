#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/fabric/client/client.hpp"
#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

/// A peer's gateway and Deliver, and an orderer's Deliver, over real TLS on a free loopback port, whose every answer a
/// test can bend: late, lost, cut off or forged. One transaction a block; its contract answers "answer to FUNCTION" and
/// emits the first argument as an event.
namespace ledgerline::fabric {

/// How a call ends; code 0 is success (grpc::StatusCode).
struct FakeStatus {
  int code = 0;
  std::string message;
  std::string detail;  ///< goes into a gateway.ErrorDetail
};

/// Where a function is missing, all goes well.
struct FakeBehaviour {
  std::function<FakeStatus(const Call&, int attempt)> endorse = {};  ///< attempt counts from 1 for each transaction
  std::function<void(common::Envelope&)> forge = {};                 ///< changes what Endorse answers
  std::function<FakeStatus(const std::string& tx_id)> before_submit = {};  ///< an error: it is not ordered
  std::function<FakeStatus(const std::string& tx_id)> after_submit = {};  ///< an error: ordered, and the answer is lost
  std::function<FakeStatus(const std::string& tx_id)> status = {};
  std::function<char(const Call&)> flag = {};                                      ///< of the transaction in its block
  std::function<std::optional<common::Block>(const common::Block&)> deliver = {};  ///< another block instead
  std::function<bool(std::uint64_t block, std::size_t transaction)> cut =
      {};  ///< end the stream with UNAVAILABLE behind this one
  std::function<std::optional<common::Block>(const common::Block&)> ordered = {};  ///< the same at the orderer
  std::optional<int> refuse_deliver = {};                                          ///< common.Status
};

class FakeGateway {
 public:
  using Behaviour = FakeBehaviour;

  explicit FakeGateway(Behaviour behaviour = {});
  ~FakeGateway();

  /// The ledger stays; the port as well.
  void stop();
  void start();

  ClientConfig client_config(crypto::Library signer = crypto::Library::libcrypto) const;
  /// The client's identity as its authority issues it again, with another key.
  crypto::SigningIdentity renewed_identity() const;
  /// Adds a block of one transaction of somebody else.
  void add_block(const std::string& function, const std::string& event);
  /// Adds a block with many.
  void add_block(const std::vector<Call>& calls);
  /// Adds a block of one transaction that is flagged valid although its event names another one.
  void add_foreign_event();

  std::vector<Block> chain() const;
  int endorse_calls() const;
  int submit_calls() const;
  int deliver_calls() const;
  int events_calls() const;
  /// Returns when the server has seen as many calls (never on a time limit of its own: ctest has one).
  void await_endorse_calls(int count) const;
  void await_status_calls(int count) const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace ledgerline::fabric
