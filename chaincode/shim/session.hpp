#pragma once
#include <condition_variable>
#include <map>
#include <mutex>

#include "chaincode/shim/shim.hpp"
#include "common/rt/workers.hpp"
#include "peer/chaincode_shim.pb.h"

namespace ledgerline::shim {

/// One peer's stream without its transport: messages in, messages out.
///
///     begin -> REGISTER ->  <- REGISTERED, READY   then, for each transaction (many at once):
///     <- TRANSACTION   GET_STATE, PUT_STATE ... -> <- RESPONSE or ERROR (one at a time)   COMPLETED ->
class Session : public std::enable_shared_from_this<Session> {
 public:
  /// False: the stream is over. Called by one thread at a time.
  using Send = std::function<bool(const protos::ChaincodeMessage& message)>;
  Session(std::string chaincode_id, Invoke invoke, Send send, Workers& workers)
      : chaincode_id_(std::move(chaincode_id)), invoke_(std::move(invoke)), send_(std::move(send)), workers_(workers) {}

  void begin();
  /// From the one thread that reads. An error ends the stream: this peer speaks another protocol.
  Status on_message(protos::ChaincodeMessage message);
  /// The stream is over: every caller that waits for the peer gets an error.
  void end();
  bool ready() const;

 private:
  friend class RemoteStub;
  struct Waiting {
    bool answered = false;
    protos::ChaincodeMessage answer;
  };
  using Key = std::pair<std::string, std::string>;  // channel, transaction

  /// A round trip; `waiting` is in waiting_ under `key`.
  Result<std::string> call_peer(const Key& key, Waiting& waiting, protos::ChaincodeMessage_Type type,
                                std::string payload);
  bool send(const protos::ChaincodeMessage& message);
  void run(const protos::ChaincodeMessage& transaction);

  const std::string chaincode_id_;
  const Invoke invoke_;
  const Send send_;
  Workers& workers_;

  std::mutex send_mutex_;
  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable answered_;
  std::map<Key, Waiting*> waiting_;
  bool ready_ = false, over_ = false;
};

}  // namespace ledgerline::shim
