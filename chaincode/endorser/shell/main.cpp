#include <atomic>
#include <chrono>
#include <nlohmann/json.hpp>

#include <thread>
#include <utility>

#include "chaincode/endorser/shell/service.hpp"
#include "chaincode/endorser/shell/settings.hpp"
#include "common/base/log.hpp"
#include "common/config/config.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/tls/certificate_watch.hpp"
#include "common/program/program.hpp"

namespace {

using namespace ledgerline;

constexpr std::chrono::milliseconds end_looked_for{100};
constexpr TimeNs max_standstill_ns = 60 * ns_per_s;  // at the start, without a further block of the peer's

int run(Config& config) {
  auto ledger = fabric::ledger_config(config);
  const endorser::Settings settings = endorser::read_settings(config);
  Status checked = config.finish();
  if (checked && !ledger) checked = ledger.error();
  if (checked && ledger->blocks != fabric::BlockSource::peer)
    checked = Error{"ledger.blocks: an endorser follows its own peer, whose answers it is to give"};
  if (!checked) return fail(checked.error(), exit_usage);
  auto certificates =
      fabric::CertificateWatch::create(*ledger, nullptr, {{settings.serve.tls_certificate, settings.serve.tls_key}});
  if (!certificates) return fail(certificates.error(), exit_usage);
  std::atomic<bool> failed{false};
  const auto tls = ledger->tls_in_use;
  auto service = endorser::Service::start(std::move(*ledger), settings, [&] { failed = true; });
  if (!service) return fail(service.error(), exit_usage);
  auto served = endorser::serve(**service, settings.serve, "serve.", tls);
  if (!served) return fail(served.error());
  (*certificates)->start(fabric::CertificateWatch::log);
  bool ready = false;
  std::uint64_t blocks = 0;
  for (TimeNs since = monotonic_ns();
       !stop_requested && !failed && !ready && monotonic_ns() - since < max_standstill_ns;) {
    ready = (*service)->wait_until_ready(0.2);
    if (const std::uint64_t now = (*service)->counts().blocks; std::exchange(blocks, now) != now)
      since = monotonic_ns();
  }
  if (!ready && !failed && !stop_requested) spdlog::error("endorser: the peer gives no block: it has {}", blocks);
  if (ready)
    print_line(nlohmann::json{{"ready", true}, {"program", "ledgerline-endorser"}, {"endpoint", (*served)->endpoint()}}
                   .dump());
  while (ready && !stop_requested && !failed) std::this_thread::sleep_for(end_looked_for);
  served->reset();
  if (!settings.summary.empty()) {
    if (Status s = endorser::write_summary(settings.summary, (*service)->counts()); !s) return fail(s.error());
  }
  return failed || (!ready && !stop_requested) ? 1 : 0;
}

const char* const about =
    "An organisation's own endorser: runs the contract against the state that its peer's blocks make, and signs what "
    "comes\n"
    "out with a certificate of its own, so that states and commands need no peer to endorse them.";

const std::string notes =
    R"(Examples:
  ledgerline endorser endorser.toml

endorser.toml:
)" + ledger_table_help +
    R"(  [serve] listen, tls_certificate, tls_key; check_one_in: how often the peer is asked whether it answers the same
  [start]  first_state, first_state_hash: a peer's snapshot to begin with, in place of all blocks
[ledger] names a peer of the organisation, an identity of its own with OU=peer, and config_block, which it needs. Prints
{"ready":true,"endpoint":...} when it has all blocks. Agent and ground name it as an [[endorser]] before the peer.
Exit codes: 0 ended by a signal; 1 it differs from its peer, or its blocks cannot be trusted; 2 bad usage or config)";

}  // namespace

int main(int argc, char** argv) { return run_with_config(argc, argv, {"ledgerline-endorser", about, notes}, run); }
