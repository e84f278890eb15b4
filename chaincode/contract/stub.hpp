#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::chaincode {

struct KeyValue {
  std::string key, value;
};

/// One old value of a key.
struct KeyVersion {
  std::string tx_id;
  TimeNs timestamp_ns = 0;
  std::string value;
};

/// The ledger as one transaction sees it: what the contract needs of Fabric's chaincode shim, and no more. Reads give
/// the committed state, never the transaction's own writes (as Fabric). On Fabric every call is a round trip.
class Stub {
 public:
  virtual ~Stub() = default;
  virtual Result<std::optional<std::string>> get_state(const std::string& key) = 0;
  virtual Status put_state(const std::string& key, const std::string& value) = 0;
  /// From the next transaction on, a write to `key` needs the endorsement of a peer of `msp_id`, and no other one. The
  /// key must be there, or be written by this call. What follows in the same block and writes the key is invalid.
  virtual Status put_policy(const std::string& key, const std::string& msp_id) = 0;
  /// Keys in [start, end), in order, at most `limit`.
  virtual Result<std::vector<KeyValue>> get_range(const std::string& start, const std::string& end,
                                                  std::size_t limit) = 0;
  /// Newest first, `limit` of them after leaving out `skip`.
  virtual Result<std::vector<KeyVersion>> get_history(const std::string& key, std::size_t skip, std::size_t limit) = 0;
  /// At most one a transaction; a second one replaces the first.
  virtual void set_event(const std::string& name, const std::string& payload) = 0;

  virtual const crypto::IdentityName& caller() const = 0;
  virtual bool caller_is_admin() const = 0;  ///< OU=admin of its organisation
};

/// What the contract answers; a refusal has a status of 500 and a message that names the reason.
struct Response {
  int status = 200;
  std::string message;
  std::string payload;
};

/// The contract: a pure function of the stub. `args` are protobuf bytes, JSON text, or plain strings, see below. Same
/// code in the embedded node and in ledgerline-chaincode. Thread-safe (no state of its own).
///
/// Forms. Answer and event have the form of the call (protobuf or JSON; plain strings count as JSON). Answers: `get`
/// gives Assets (in JSON, of one id: the asset alone), `history` Versions, `stop` Stops, enroll, acquire, release,
/// clear_stop and apply_stops give Controls (the records as they now are, with their epochs); set, delete and command
/// give nothing. Events are as in ledgerline.proto; readers take both forms (common/msg/proto_json.hpp). Plain strings
/// are ids or drones; options follow as `priority=5` (acquire), `cut=true` (stop), `bookmark=...` (get, history).
///
/// A refusal for one id or drone begins with it: "tello3: the lease is held by ...", "tello3/odom: ...". So a client
/// can send the rest again.
Response invoke(Stub& stub, const std::string& function, const std::vector<std::string>& args);

}  // namespace ledgerline::chaincode
