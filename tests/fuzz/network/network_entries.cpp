#include <google/protobuf/any.pb.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "common/dds/dds.hpp"
#include "common/fabric/client/connection.hpp"
#include "common/fabric/config.hpp"
#include "gateway/gateway.pb.h"
#include "onboard/agent/shell/settings.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "tests/fuzz/directory.hpp"
#include "tests/fuzz/entry.hpp"

/// What only programs with network parts read: the settings of link and agent, those of a ledger's client, and why a
/// peer refused.
namespace ledgerline::fuzz::network_part {
namespace {

class LinkEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    return {
        "[[drone]]\nname = \"tello1\"\naddress = \"127.0.0.2\"\n[[drone]]\nname = \"tello2\"\nnumber = 5\n"
        "address = \"127.0.0.3\"\n[tello]\ncommand_port = 8889\n[state]\nlisten = \"0.0.0.0:8890\"\nrate_hz = 30.0\n"
        "[output]\ntrace = \"t\"\nsummary = \"s\"\nstatus_period_ms = 250\n[realtime]\nloop_hz = 1000\npriority = 0\n"
        "cpu = -1\n[limits]\nspeed_mps = 0.7\nvertical_mps = 1.0\nacceleration_mps2 = 4\nyaw_rate_radps = 1.75\n",
        "[[drone]]\nname = \"tello1\"\naddress = \"192.168.10.1\"\n[rc]\nfull_scale_mps = 1\nsigns = [-1, 1, 1, -1]\n"
        "[playout]\nmax_age_ms = 500\nmax_ahead_ms = 5000\n[failsafe]\nhold_grace_ms = 100\nland_after_s = 5\n"
        "battery_low = 0.15\nbattery_critical = 0.08\n[fence]\nmin_m = [-2.0, -2.0, 0.0]\nmax_m = [2.0, 2, 3]\n"
        "land_after_ms = 1000\nfar_beyond_m = 1\n"};
  }
  Outcome feed(std::string_view bytes) override {
    const std::string path = directory_.path + "/link.toml";
    std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    const auto settings = link::load_settings(path);
    if (!settings) return refused(settings.error().message);
    const auto& fence = settings->link.fence;
    for (std::size_t i = 0; i < 3; ++i) {
      if (!(fence.max_m[i] > fence.min_m[i])) return refused("");
    }
    const bool whole = settings->addresses.size() == settings->link.drones.size() && !settings->addresses.empty() &&
                       settings->link.rate_hz >= 1 && settings->state_listen.sin_port != 0;
    return whole ? accepted() : refused("");
  }

 private:
  Directory directory_;
};

std::unique_ptr<Entry> agent_settings() {
  return std::make_unique<Function>(
      std::vector<std::string>{
          "[[drone]]\nname = \"tello1\"\nnumber = 1\n[[drone]]\nname = \"tello2\"\n[batch]\nmin_gap_ms = 0\nlinger_ms "
          "= "
          "0.5\nfirst_back_off_ms = 20\nmax_back_off_ms = 1000\nrefused_drone_pause_ms = 1000\n[check]\nmax_age_ms "
          "= "
          "500\nmax_speed_mps = 8\nstamps_kept = 256\n[mocap]\ntopic = \"/vrpn_mocap/{drone}/pose\"\nclock = "
          "\"arrival\"\n"
          "gate_sigma = 6\noutliers_before_reset = 5\n[agent]\nheartbeat_ms = 50\nseed = 7\nstart_wait_s = "
          "15.0\n[output]\n"
          "status_period_ms = 250\n[realtime]\npriority = 10\n[dds]\ndomain = 7\nlocal_only = false\n"
          "identity_ca = \"ca.pem\"\ncertificate = \"me.pem\"\nprivate_key = \"me.key\"\ngovernance = \"g.p7s\"\n"
          "permissions = \"p.p7s\"\n[[topic]]\nname = \"/tello1/note\"\nfrom = \"tello1\"\nrate_hz = 5\n",
          "[[drone]]\nname = \"tello1\"\n"},
      [](std::string_view bytes) {
        auto config = Config::parse(bytes, "agent.toml");
        if (!config) return refused(config.error().message);
        const agent::Settings settings = agent::read_settings(*config, "Org1MSP", {});
        (void)agent::read_bridge(*config, settings.core.drones);
        (void)dds::participant_options(*config, "ledgerline_agent");
        const Status status = config->finish();
        if (!status) return refused(status.error().message);
        const bool sane = settings.core.heartbeat_period_ns > 0 && settings.core.check.max_age_ns > 0 &&
                          settings.core.check.stamps_kept > 0 && settings.start_wait_ns > 0;
        return sane ? accepted() : refused("");
      });
}

class LedgerEntry final : public Entry {
 public:
  LedgerEntry() {
    const auto ca = crypto::make_ca("ca.org1", "org1").value();
    const auto user =
        crypto::issue(ca, {.common_name = "User1@org1", .organization = "", .unit = "client", .sans = {}}).value();
    std::filesystem::create_directories(directory_.path + "/msp/signcerts");
    std::filesystem::create_directories(directory_.path + "/msp/keystore");
    std::ofstream(directory_.path + "/ca.pem") << ca.certificate_pem;
    std::ofstream(directory_.path + "/msp/signcerts/cert.pem") << user.certificate_pem;
    std::ofstream(directory_.path + "/msp/keystore/priv_sk") << user.key_pem;
    ::chmod((directory_.path + "/msp/keystore/priv_sk").c_str(), 0600);
  }
  std::vector<std::string> seeds() override {
    return {
        "[ledger]\nendpoint = \"127.0.0.1:7051\"\ntls_ca = \"" + directory_.path +
        "/ca.pem\"\nmsp_id = \"Org1MSP\"\nmsp_dir = \"" + directory_.path +
        "/msp\"\nsigner = \"libcrypto\"\nmax_in_flight = 64\ndeadline_ms = 5000\nchannel = \"teleop\"\n[[msp]]\nid = "
        "\"Org1MSP\"\nca = \"" +
        directory_.path + "/ca.pem\"\n"};
  }
  Outcome feed(std::string_view bytes) override {
    auto config = Config::parse(bytes, "agent.toml");
    if (!config) return refused(config.error().message);
    const auto client = fabric::ledger_config(*config);
    const auto registry = fabric::msp_registry(*config);
    const Status status = config->finish();
    if (!status) return refused(status.error().message);
    if (!client) return refused(client.error().message);
    if (!registry) return refused(registry.error().message);
    return client->endpoint.empty() ? refused("") : accepted();
  }

 private:
  Directory directory_;
};

/// google.rpc.Status as a gateway sends it with a refusal.
std::unique_ptr<Entry> error_details() {
  gateway::ErrorDetail detail;
  detail.set_address("peer0:7051");
  detail.set_msp_id("Org1MSP");
  detail.set_message("chaincode response 500, tello1: the lease is held by nobody");
  google::protobuf::Any any;
  any.set_type_url("type.googleapis.com/gateway.ErrorDetail");
  any.set_value(detail.SerializeAsString());
  const std::string packed = any.SerializeAsString();
  std::string status = "\x08\x0a\x12\x04text\x1a";
  status += static_cast<char>(packed.size());  // below 128 or two bytes
  if (packed.size() > 127) {
    status.back() = static_cast<char>(packed.size() | 0x80);
    status += static_cast<char>(packed.size() >> 7);
  }
  status += packed;
  return std::make_unique<Function>(std::vector<std::string>{status}, [](std::string_view bytes) {
    const grpc::Status refusal(grpc::StatusCode::ABORTED, "failed to endorse", std::string(bytes));
    const std::string text = fabric::describe(refusal);
    if (text.empty()) return refused("");
    return text == "failed to endorse" ? dropped() : accepted();
  });
}

const Registration link_config({"config.link", Kind::toml, [] { return std::make_unique<LinkEntry>(); }});
const Registration agent_config({"config.agent", Kind::toml, agent_settings});
const Registration ledger_config({"config.ledger", Kind::toml, [] { return std::make_unique<LedgerEntry>(); }});
const Registration details({"fabric.error_details", Kind::protobuf, error_details});

}  // namespace
}  // namespace ledgerline::fuzz::network_part
