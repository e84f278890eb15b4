#include "chaincode/shim/session.hpp"

#include "common/common.pb.h"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/tx/policy.hpp"
#include "ledger/queryresult/kv_query_result.pb.h"
#include "peer/chaincode.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"

namespace ledgerline::shim {
namespace {

using Message = protos::ChaincodeMessage;

/// The proposal's creator; nullopt when it does not parse.
std::optional<std::string> creator_of(const protos::SignedProposal& signed_proposal) {
  protos::Proposal proposal;
  common::Header header;
  common::SignatureHeader signature_header;
  if (!proposal.ParseFromString(signed_proposal.proposal_bytes()) || !header.ParseFromString(proposal.header()) ||
      !signature_header.ParseFromString(header.signature_header())) {
    return std::nullopt;
  }
  return signature_header.creator();
}

}  // namespace

std::string peer_policy(const std::string& msp_id) { return fabric::peer_policy(msp_id); }

class RemoteStub final : public Stub {
 public:
  RemoteStub(Session& session, Session::Key key, std::string creator, std::vector<std::string> args)
      : session_(session), key_(std::move(key)), creator_(std::move(creator)), args_(std::move(args)) {
    const std::lock_guard lock(session_.mutex_);
    session_.waiting_[key_] = &waiting_;
  }
  ~RemoteStub() override {
    const std::lock_guard lock(session_.mutex_);
    session_.waiting_.erase(key_);
  }
  RemoteStub(const RemoteStub&) = delete;
  RemoteStub& operator=(const RemoteStub&) = delete;

  const std::string& channel() const override { return key_.first; }
  const std::string& tx_id() const override { return key_.second; }
  const std::string& creator() const override { return creator_; }
  const std::vector<std::string>& args() const override { return args_; }

  Result<std::optional<std::string>> get_state(const std::string& key) override {
    protos::GetState request;
    request.set_key(key);
    auto answer = call_peer(Message::GET_STATE, request);
    if (!answer) return answer.error();
    if (answer->empty()) return std::optional<std::string>{};
    return std::optional(std::move(*answer));
  }
  Status put_state(const std::string& key, const std::string& value) override {
    protos::PutState request;
    request.set_key(key);
    request.set_value(value);
    return done_or_error(call_peer(Message::PUT_STATE, request));
  }
  Status del_state(const std::string& key) override {
    protos::DelState request;
    request.set_key(key);
    return done_or_error(call_peer(Message::DEL_STATE, request));
  }

  Status set_state_validation_parameter(const std::string& key, const std::string& policy) override {
    protos::PutStateMetadata request;
    request.set_key(key);
    request.mutable_metadata()->set_metakey("VALIDATION_PARAMETER");
    request.mutable_metadata()->set_value(policy);
    return done_or_error(call_peer(Message::PUT_STATE_METADATA, request));
  }

  Result<std::vector<KeyValue>> get_range(const std::string& start, const std::string& end,
                                          std::size_t limit) override {
    protos::GetStateByRange request;
    request.set_startkey(start);
    request.set_endkey(end);
    std::vector<KeyValue> found;
    Status status = query(Message::GET_STATE_BY_RANGE, request, limit, [&](const std::string& bytes) {
      queryresult::KV entry;
      if (!entry.ParseFromString(bytes)) return false;
      found.push_back({entry.key(), entry.value()});
      return true;
    });
    if (!status) return status.error();
    return found;
  }

  Result<std::vector<KeyModification>> get_history(const std::string& key, std::size_t skip,
                                                   std::size_t limit) override {
    protos::GetHistoryForKey request;
    request.set_key(key);
    std::vector<KeyModification> found;
    std::size_t left_out = 0;
    Status status = query(Message::GET_HISTORY_FOR_KEY, request, skip + limit, [&](const std::string& bytes) {
      queryresult::KeyModification entry;
      if (!entry.ParseFromString(bytes)) return false;
      if (left_out++ < skip) return true;
      found.push_back({entry.tx_id(), entry.value(), fabric::time_of(entry.timestamp()), entry.is_delete()});
      return true;
    });
    if (!status) return status.error();
    return found;
  }

  void set_event(const std::string& name, const std::string& payload) override {
    event.emplace();
    event->set_event_name(name);
    event->set_payload(payload);
  }

  std::optional<protos::ChaincodeEvent> event;

 private:
  Result<std::string> call_peer(Message::Type type, const google::protobuf::MessageLite& request) {
    return session_.call_peer(key_, waiting_, type, request.SerializeAsString());
  }
  static Status done_or_error(const Result<std::string>& answer) {
    if (!answer) return answer.error();
    return done;
  }

  /// Feeds up to `limit` results to `take`, page after page, and closes the query; false from `take`: it is damaged.
  Status query(Message::Type type, const google::protobuf::MessageLite& request, std::size_t limit,
               const std::function<bool(const std::string& bytes)>& take) {
    auto answer = call_peer(type, request);
    std::size_t taken = 0;
    for (;;) {
      if (!answer) return answer.error();
      protos::QueryResponse page;
      if (!page.ParseFromString(*answer)) return Error{"the peer's answer to a query does not parse"};
      for (const auto& result : page.results()) {
        if (taken == limit) break;
        if (!take(result.resultbytes())) return Error{"a result of the peer's query does not parse"};
        ++taken;
      }
      // The peer closes a query itself when it has given everything.
      if (!page.has_more()) return done;
      if (taken == limit) {
        protos::QueryStateClose close;
        close.set_id(page.id());
        return done_or_error(call_peer(Message::QUERY_STATE_CLOSE, close));
      }
      protos::QueryStateNext next;
      next.set_id(page.id());
      answer = call_peer(Message::QUERY_STATE_NEXT, next);
    }
  }

  Session& session_;
  const Session::Key key_;
  const std::string creator_;
  const std::vector<std::string> args_;
  Session::Waiting waiting_;
};

void Session::begin() {
  protos::ChaincodeID id;
  id.set_name(chaincode_id_);
  Message message;
  message.set_type(Message::REGISTER);
  message.set_payload(id.SerializeAsString());
  send(message);
}

Status Session::on_message(Message message) {
  switch (message.type()) {
    case Message::REGISTERED:
    case Message::KEEPALIVE:
      return done;
    case Message::READY: {
      const std::lock_guard lock(mutex_);
      ready_ = true;
      return done;
    }
    case Message::INIT:
    case Message::TRANSACTION: {
      const std::string tx_id = message.txid(), channel = message.channel_id();
      const auto self = shared_from_this();
      if (workers_.post([self, transaction = std::move(message)] { self->run(transaction); })) return done;
      Message refusal;
      refusal.set_type(Message::ERROR);
      refusal.set_payload("the chaincode has too many transactions waiting");
      refusal.set_txid(tx_id);
      refusal.set_channel_id(channel);
      send(refusal);
      return done;
    }
    case Message::RESPONSE:
    case Message::ERROR: {
      const std::lock_guard lock(mutex_);
      const auto found = waiting_.find({message.channel_id(), message.txid()});
      if (found == waiting_.end()) return done;  // of a transaction that has ended
      found->second->answer = std::move(message);
      found->second->answered = true;
      answered_.notify_all();
      return done;
    }
    default:
      return Error{"the peer sent a message of type " + std::to_string(message.type()) + ", which has no place here"};
  }
}

void Session::end() {
  const std::lock_guard lock(mutex_);
  over_ = true;
  answered_.notify_all();
}

bool Session::ready() const {
  const std::lock_guard lock(mutex_);
  return ready_ && !over_;
}

bool Session::send(const Message& message) {
  const std::lock_guard lock(send_mutex_);
  return send_(message);
}

Result<std::string> Session::call_peer(const Key& key, Waiting& waiting, Message::Type type, std::string payload) {
  Message request;
  request.set_type(type);
  request.set_payload(std::move(payload));
  request.set_channel_id(key.first);
  request.set_txid(key.second);
  {
    const std::lock_guard lock(mutex_);
    waiting.answered = false;
  }
  if (!send(request)) return Error{"the peer is gone"};
  std::unique_lock lock(mutex_);
  // Without a limit of its own: the peer ends a transaction that takes too long, and a peer that is gone ends the
  // stream.
  answered_.wait(lock, [&] { return waiting.answered || over_; });
  if (!waiting.answered) return Error{"the peer is gone"};
  if (waiting.answer.type() == Message::ERROR) return Error{waiting.answer.payload()};
  return std::move(*waiting.answer.mutable_payload());
}

void Session::run(const Message& transaction) {
  Message answer;
  answer.set_txid(transaction.txid());
  answer.set_channel_id(transaction.channel_id());
  protos::ChaincodeInput input;
  const auto creator = creator_of(transaction.proposal());
  if (!input.ParseFromString(transaction.payload()) || !creator) {
    answer.set_type(Message::ERROR);
    answer.set_payload("the transaction's input or proposal does not parse");
    send(answer);
    return;
  }
  Response response;
  {
    RemoteStub stub(*this, {transaction.channel_id(), transaction.txid()}, *creator,
                    {input.args().begin(), input.args().end()});
    response = invoke_(stub);
    if (stub.event) *answer.mutable_chaincode_event() = std::move(*stub.event);
  }
  // Only now: once the peer knows the end it may begin a transaction of the same id, whose answers must find it.
  protos::Response out;
  out.set_status(response.status);
  out.set_message(response.message);
  out.set_payload(response.payload);
  answer.set_type(Message::COMPLETED);
  answer.set_payload(out.SerializeAsString());
  send(answer);
}

}  // namespace ledgerline::shim
