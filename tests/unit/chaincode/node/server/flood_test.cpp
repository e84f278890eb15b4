#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "common/fabric/client/client.hpp"
#include "common/rt/clock.hpp"
#include "tests/unit/chaincode/node/server/raw_call.hpp"
#include "tests/unit/child.hpp"

/// The real node is flooded by others; a normal client is served during and after it. How fast is printed.
namespace ledgerline::node {
namespace {

using std::chrono_literals::operator""s;

constexpr int connections = 10, streams = 1000;
constexpr std::size_t calls = 10;

std::string program;  // the path of ledgerline-node

class FloodTest : public ::testing::Test {
 protected:
  FloodTest() : dir_(std::filesystem::temp_directory_path() / ("ledgerline_flood_" + std::to_string(::getpid()))) {
    std::filesystem::remove_all(dir_);
  }
  ~FloodTest() override { std::filesystem::remove_all(dir_); }

  void SetUp() override {
    ASSERT_TRUE(node_.start({program, "--dir", dir_, "--listen", "127.0.0.1:0"}));
    const std::string organisation = dir_.string() + "/crypto/peerOrganizations/org1.ledgerline";
    fabric::ClientConfig config;
    config.endpoint = nlohmann::json::parse(node_.ready_line())["endpoint"];
    config.tls_ca_file = organisation + "/tlsca/tlsca.org1.ledgerline-cert.pem";
    config.deadline = 20s;
    user_ = *crypto::load_identity(crypto::Library::libcrypto, "Org1MSP",
                                   organisation + "/users/User1@org1.ledgerline/msp");
    config.identity = user_;
    std::stringstream ca;
    ca << std::ifstream(config.tls_ca_file).rdbuf();
    grpc::SslCredentialsOptions tls;
    tls.pem_root_certs = ca.str();
    for (int i = 0; i < connections; ++i) {
      grpc::ChannelArguments arguments;
      arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
      channels_.push_back(grpc::CreateCustomChannel(config.endpoint, grpc::SslCredentials(tls), arguments));
    }
    auto client = fabric::Client::create(std::move(config));
    ASSERT_TRUE(client.ok()) << client.error().message;
    client_ = std::move(*client);
    normal_client("before");
  }

  /// One call after the other; each must commit.
  void normal_client(const char* when) {
    std::vector<double> took_ms;
    for (std::size_t i = 0; i < calls; ++i) {
      const TimeNs begin = monotonic_ns();
      const auto outcome = client_->submit_and_wait({"set", {R"({"id":"tello1/note","msgType":"t"})"}});
      ASSERT_EQ(outcome.kind, fabric::Outcome::Kind::committed) << when << ": " << outcome.message;
      took_ms.push_back(static_cast<double>(monotonic_ns() - begin) / ns_per_ms);
    }
    std::sort(took_ms.begin(), took_ms.end());
    std::printf("normal client %s: median %.1f ms, maximum %.1f ms, node %.0f MB\n", when, took_ms[calls / 2],
                took_ms.back(), node_.resident_mb());
  }

  /// Keeps `count` calls open until `over`, each opened again when it ends, then waits for their ends.
  class Flood {
   public:
    Flood(std::vector<std::shared_ptr<grpc::Channel>> channels, std::string method, std::string request)
        : channels_(std::move(channels)), method_(std::move(method)), request_(std::move(request)) {}
    ~Flood() { end(); }
    /// Returns when it has begun to be felt.
    void begin(int count) {
      for (int i = 0; i < count; ++i) open(i);
      for (int i = 0; i < 1000 && messages + ends == 0; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    void end() {
      over_ = true;
      while (open_ > 0) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    std::atomic<std::uint64_t> messages{0}, ends{0};

   private:
    void open(int number) {
      ++open_;
      RawCall::start(
          channels_[static_cast<std::size_t>(number) % channels_.size()], method_, request_, 5s,
          [this](const std::string&) {
            ++messages;
            return !over_;
          },
          [this, number](const grpc::Status&) {
            ++ends;
            if (!over_) open(number);
            --open_;
          });
    }
    const std::vector<std::shared_ptr<grpc::Channel>> channels_;
    const std::string method_, request_;
    std::atomic<bool> over_{false};
    std::atomic<int> open_{0};
  };

  std::string seek() const { return *fabric::make_seek(user_, "teleop", 0, realtime_ns(), std::string(24, 'n')); }

  std::filesystem::path dir_;
  Child node_;
  crypto::SigningIdentity user_;
  std::vector<std::shared_ptr<grpc::Channel>> channels_;
  std::unique_ptr<fabric::Client> client_;
};

TEST_F(FloodTest, AThousandReadersLeaveANormalClientServed) {
  Flood flood(channels_, "/protos.Deliver/Deliver", seek());
  flood.begin(streams);
  normal_client("during");
  EXPECT_GT(flood.messages, std::uint64_t{streams}) << "there was no flood";
  std::printf("%llu blocks were read\n", static_cast<unsigned long long>(flood.messages));
  normal_client("still");  // wakes those who read on
  flood.end();
  normal_client("after");
}

TEST_F(FloodTest, AThousandStreamsOfGarbageLeaveANormalClientServed) {
  Flood flood(channels_, "/orderer.AtomicBroadcast/Broadcast", "garbage");
  flood.begin(streams);
  normal_client("during");
  EXPECT_GT(flood.ends, std::uint64_t{streams}) << "there was no flood";
  std::printf("%llu streams were refused\n", static_cast<unsigned long long>(flood.ends));
  flood.end();
  normal_client("after");
}

TEST_F(FloodTest, ManyLargeRequestsAtOnceLeaveANormalClientServed) {
  Flood flood(channels_, "/gateway.Gateway/Submit", std::string(8'000'000, 'x'));
  flood.begin(20);
  normal_client("during");
  EXPECT_GT(flood.ends, 0U) << "there was no flood";
  std::printf("%llu requests of 8 MB were refused\n", static_cast<unsigned long long>(flood.ends));
  EXPECT_LT(node_.resident_mb(), 1500);
  flood.end();
  normal_client("after");
}

}  // namespace
}  // namespace ledgerline::node

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  ::testing::InitGoogleTest(&argc, argv);
  if (argc != 2) return std::fprintf(stderr, "usage: %s LEDGERLINE-NODE\n", argv[0]), 2;
  ledgerline::node::program = argv[1];
  return RUN_ALL_TESTS();
}
