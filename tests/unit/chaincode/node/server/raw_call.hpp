#pragma once
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/client_callback.h>

#include <chrono>
#include <functional>
#include <string>

namespace ledgerline::node {

/// Any call, unary or stream, with any bytes as its one request. Ends, and is gone, after on_done.
class RawCall final : public grpc::ClientBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  /// False: enough, end the call.
  using Message = std::function<bool(const std::string& message)>;
  using Done = std::function<void(const grpc::Status& status)>;

  static void start(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                    const std::string& request, std::chrono::milliseconds deadline, Message on_message, Done on_done) {
    auto* call = new RawCall(std::move(on_message), std::move(on_done));
    call->context_.set_deadline(std::chrono::system_clock::now() + deadline);
    const grpc::Slice bytes(request);
    call->request_ = grpc::ByteBuffer(&bytes, 1);
    grpc::GenericStub(channel).PrepareBidiStreamingCall(&call->context_, method, {}, call);
    call->StartWriteLast(&call->request_, {});
    call->StartRead(&call->response_);
    call->StartCall();
  }

  void OnReadDone(bool ok) override {
    if (!ok) return;
    grpc::Slice bytes;
    (void)response_.DumpToSingleSlice(&bytes);
    if (!on_message_({reinterpret_cast<const char*>(bytes.begin()), bytes.size()})) context_.TryCancel();
    StartRead(&response_);
  }
  void OnDone(const grpc::Status& status) override {
    on_done_(status);
    delete this;
  }

 private:
  RawCall(Message on_message, Done on_done) : on_message_(std::move(on_message)), on_done_(std::move(on_done)) {}

  Message on_message_;
  Done on_done_;
  grpc::ClientContext context_;
  grpc::ByteBuffer request_, response_;
};

}  // namespace ledgerline::node
