#include <fmt/format.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/client_callback.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdio>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/rt/clock.hpp"

/// Does one wrong thing to a ledger until SIGTERM or for so long, beside a flight; what it did is a line of JSON at the
/// end.
namespace {

using namespace ledgerline;
using nlohmann::json;

/// An outsider's stream: opened, and nothing is said in it. Opened again when it ends, a moment later.
class SilentStream final : public grpc::ClientBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  SilentStream(const std::shared_ptr<grpc::Channel>& channel, std::atomic<std::uint64_t>& ended) : ended_(ended) {
    grpc::GenericStub(channel).PrepareBidiStreamingCall(&context_, "/protos.Deliver/Deliver", {}, this);
    StartRead(&response_);
    StartCall();
  }
  void cancel() { context_.TryCancel(); }
  bool over() const { return over_; }
  void OnDone(const grpc::Status&) override {
    ++ended_;
    over_ = true;
  }

 private:
  std::atomic<std::uint64_t>& ended_;
  std::atomic<bool> over_{false};
  grpc::ClientContext context_;
  grpc::ByteBuffer response_;
};

json silent(const fabric::ClientConfig& config, TimeNs end_ns) {
  constexpr int connections = 26, streams = 100;
  grpc::SslCredentialsOptions tls;
  tls.pem_root_certs = *read_file(config.tls_ca_file);
  std::atomic<std::uint64_t> ended{0};
  std::uint64_t opened = 0;
  struct Place {
    std::shared_ptr<grpc::Channel> channel;
    std::unique_ptr<SilentStream> stream{};
  };
  std::vector<Place> places;
  for (int i = 0; i < connections; ++i) {
    grpc::ChannelArguments own;
    own.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    const auto channel = grpc::CreateCustomChannel(config.endpoint, grpc::SslCredentials(tls), own);
    for (int k = 0; k < streams; ++k) places.push_back({channel});
  }
  while (monotonic_ns() < end_ns) {
    for (Place& place : places) {
      if (place.stream && !place.stream->over()) continue;
      place.stream = std::make_unique<SilentStream>(place.channel, ended);
      ++opened;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  for (Place& place : places) {
    if (place.stream) place.stream->cancel();
  }
  for (const Place& place : places) {
    while (place.stream && !place.stream->over()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return {{"opened", opened}, {"ended", ended.load()}};
}

/// Calls of a member, several at once.
template <typename NextCall>
json submit(const fabric::ClientConfig& config, TimeNs end_ns, std::uint64_t max_calls, NextCall next) {
  constexpr std::uint64_t at_once = 4;
  auto client = fabric::Client::create(config);
  if (!client) throw std::runtime_error(client.error().message);
  std::atomic<std::uint64_t> committed{0}, refused{0};
  std::mutex mutex;
  std::string refusal;  // the newest
  std::uint64_t sent = 0;
  const auto waits = [&] { return sent - committed - refused; };
  while ((monotonic_ns() < end_ns && sent < max_calls) || waits() > 0) {
    if (waits() >= at_once || monotonic_ns() >= end_ns || sent >= max_calls) {
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
      continue;
    }
    (*client)->submit(next(sent++), [&](const fabric::Outcome& outcome) {
      if (outcome.kind == fabric::Outcome::Kind::committed) {
        ++committed;
        return;
      }
      const std::lock_guard lock(mutex);
      refusal = outcome.message;
      ++refused;
    });
  }
  return {{"sent", sent}, {"committed", committed.load()}, {"refused", refused.load()}, {"refusal", refusal}};
}

json garbage(const fabric::ClientConfig& config, TimeNs end_ns) {
  const std::string bytes = crypto::random_bytes(9'900'000);
  return submit(config, end_ns, 1'000'000, [&](std::uint64_t) { return fabric::Call{"set", {bytes}}; });
}

json values(const fabric::ClientConfig& config, TimeNs end_ns) {
  constexpr std::size_t value_bytes = 700'000, all_bytes = 300'000'000;
  const std::string value(value_bytes / 3 * 4, 'A');  // in base64
  return submit(config, end_ns, all_bytes / value_bytes, [&](std::uint64_t number) {
    return fabric::Call{"set",
                        {json{{"id", fmt::format("{}/abuse{}", config.identity.name.msp_id, number)},
                              {"msgType", "t"},
                              {"msgData", value}}
                             .dump()}};
  });
}

json burn(TimeNs end_ns) {
  std::uint64_t turns = 0;
  while (monotonic_ns() < end_ns) ++turns;
  return {{"turns", turns}};
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Does one wrong thing to a ledger, for so long");
  std::string file, what;
  double seconds = 20;
  app.add_option("--config", file)->required();
  app.add_option("what", what)->required()->check(CLI::IsMember({"silent", "garbage", "values", "burn"}));
  app.add_option("--seconds", seconds);
  CLI11_PARSE(app, argc, argv);
  auto loaded = Config::load(file);
  auto config = loaded ? fabric::ledger_config(*loaded) : Result<fabric::ClientConfig>(loaded.error());
  if (!config) return std::fprintf(stderr, "%s\n", config.error().message.c_str()), 2;
  const TimeNs end_ns = monotonic_ns() + from_seconds(seconds);
  const json reported = what == "silent"    ? silent(*config, end_ns)
                        : what == "garbage" ? garbage(*config, end_ns)
                        : what == "values"  ? values(*config, end_ns)
                                            : burn(end_ns);
  std::puts(reported.dump().c_str());
}
