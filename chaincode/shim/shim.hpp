#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

/// C++ chaincode for Fabric 2.5, as a service: the peers connect to this process (protos.Chaincode/Connect), as many as
/// want to, and come back by themselves. An example is example.cpp beside this file; a real one is ../service; the
/// tutorial is docs/library.md. Keys, values, arguments and payloads are bytes; keys must be UTF-8 (Fabric's rule).
/// Left out of Fabric's shims: private data, rich queries, calls of other chaincodes.
namespace ledgerline::shim {

struct KeyValue {
  std::string key, value;
};

/// One old value of a key.
struct KeyModification {
  std::string tx_id;
  std::string value;
  TimeNs timestamp_ns = 0;  ///< as the client claimed it; 0: no time of our age
  bool is_delete = false;
};

/// The ledger as one transaction sees it: reads give the committed state, never the transaction's own writes. Each call
/// but set_event and the plain facts is a round trip to the peer; an error says what the peer said, or that it is gone.
/// To be used on the thread that Invoke was called on, until it returns. Every peer that endorses runs the transaction
/// and all must come to the same writes: no clocks, no random numbers, no state of the process.
class Stub {
 public:
  virtual ~Stub() = default;

  virtual const std::string& channel() const = 0;
  virtual const std::string& tx_id() const = 0;
  /// Who signed the proposal: a msp.SerializedIdentity that the peer has checked.
  virtual const std::string& creator() const = 0;
  /// The function's name first.
  virtual const std::vector<std::string>& args() const = 0;

  /// nullopt: no such key. (Fabric does not distinguish an empty value from none.)
  virtual Result<std::optional<std::string>> get_state(const std::string& key) = 0;
  virtual Status put_state(const std::string& key, const std::string& value) = 0;
  virtual Status del_state(const std::string& key) = 0;
  /// The key's own endorsement policy, a serialized common.SignaturePolicyEnvelope (peer_policy makes one), in place of
  /// the chaincode's from the next transaction on. Of a key that is there or is written by this transaction; a deletion
  /// takes it along. What follows in the same block and writes the key is invalid.
  virtual Status set_state_validation_parameter(const std::string& key, const std::string& policy) = 0;
  /// Keys in [start, end) in order, at most `limit`.
  virtual Result<std::vector<KeyValue>> get_range(const std::string& start, const std::string& end,
                                                  std::size_t limit) = 0;
  /// Newest first, `limit` of them after leaving out `skip`. The peer needs its history database.
  virtual Result<std::vector<KeyModification>> get_history(const std::string& key, std::size_t skip,
                                                           std::size_t limit) = 0;
  /// At most one a transaction; a second one replaces the first.
  virtual void set_event(const std::string& name, const std::string& payload) = 0;
};

struct Response {
  int status = 200;     ///< 400 and above: refused, nothing is written; as Fabric's shims, 200 and 500 are usual
  std::string message;  ///< why it was refused, for people
  std::string payload;  ///< the answer, at most 100 MB
};

/// "A peer of this organisation endorses", as a policy.
std::string peer_policy(const std::string& msp_id);

/// The chaincode. Called on many threads at once; must not throw.
using Invoke = std::function<Response(Stub& stub)>;

struct Options {
  std::string chaincode_id;      ///< the package id, "label:hash"
  std::string address;           ///< where to listen, "127.0.0.1:9999"; port 0 takes a free one
  std::string key_file;          ///< PEM; empty: no TLS, at a loopback address alone
  std::string certificate_file;  ///< PEM
  std::string client_ca_file;    ///< PEM; given: peers must show a certificate that it signed
  /// Names (common or alternative) of whose certificates are taken, since that authority signs clients' and orderers',
  /// too. Empty: any that it signed.
  std::vector<std::string> client_names{};
  int threads = 16;  ///< transactions at once; more wait
};

/// From CHAINCODE_ID, CHAINCODE_SERVER_ADDRESS, CHAINCODE_TLS_KEY, CHAINCODE_TLS_CERT and CHAINCODE_TLS_CLIENT_CA, as
/// chaincode services are started everywhere; the last three name files and may be missing together. And, our own,
/// CHAINCODE_TLS_CLIENT_NAMES: client_names, with commas between.
Result<Options> options_from_environment();

/// A package id as peers have it, "label:64 hex digits": any other is one that no peer will ever ask for. Takes off one
/// newline at the end, which a secret of Kubernetes often has.
Result<std::string> package_id_from(std::string text);

/// Serves on threads of its own until stop() or its end; all methods from any thread, stop() not from within Invoke. A
/// call more than 1,000 that wait for a thread is refused. Losing a peer ends that peer's transactions alone.
class Server {
 public:
  /// An error: address, key or certificate cannot be used.
  static Result<std::unique_ptr<Server>> start(const Options& options, Invoke invoke);
  virtual ~Server() = default;
  /// With the port that was taken.
  virtual const std::string& endpoint() const = 0;
  /// Ends all streams; transactions that run are answered with an error by their peers.
  virtual void stop() = 0;
};

}  // namespace ledgerline::shim
