#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>

#include "tools/launcher/configs.hpp"
#include "tools/launcher/launcher.hpp"
#include "tools/launcher/machine.hpp"

// What the launcher does until a ledger is there, and who may fly what stands on it.

namespace ledgerline::launcher {

using nlohmann::json;

namespace {

constexpr TimeNs acquire_limit_ns = 5 * ns_per_s;  // a call's deadline

}  // namespace

Status FlightLedger::start() {
  std::vector<std::string> ledger{
      "--dir",     files_.in("ledger"),      "--batch-count",   std::to_string(options_.batch_count),
      "--summary", files_.summary(program_), "--batch-timeout", std::to_string(options_.batch_timeout_ns / ns_per_ms)};
  for (const std::string& name : drone_names(options_)) ledger.insert(ledger.end(), {"--drone", name});
  if (options_.ledger == Ledger::fabric) {
    ledger.insert(ledger.begin(), "run");
    ledger.insert(ledger.end(), {"--orderers", std::to_string(options_.orderers)});
    if (options_.ca) ledger.push_back("--ca");
    for (int organisation = 1; waits_for_no_peer(options_) && organisation <= 3; ++organisation)
      ledger.insert(ledger.end(), {"--background", fmt::format("org{}", organisation)});
  } else {
    ledger.insert(ledger.end(), {"--listen", "127.0.0.1:0"});
  }
  return programs_.start(program_, ledger);
}

Status FlightLedger::prepare() {
  if (is_of_others(options_)) {
    if (auto s = preflight_.blocks_fit(); !s) return s;
    if (auto s = write_configs(files_, options_, LedgerEndpoints{}); !s) return s;
    return enroll_and_acquire();
  }
  const json ready = json::parse(programs_.ready_line(program_));
  if (!ready.contains("endpoint") || !ready["endpoint"].is_string()) {
    return Error{program_ + " did not say its endpoint: " + programs_.ready_line(program_)};
  }
  const auto texts = [&](const char* key) {
    std::vector<std::string> all;
    for (const json& one : ready.value(key, json::array()))
      all.push_back(one.is_string() ? one.get<std::string>() : "");
    return all;
  };
  LedgerEndpoints endpoints{ready["endpoint"], texts("orderers"), texts("peers")};
  if (options_.endorser) {
    if (auto s = start_endorser(endpoints); !s) return s;
  }
  if (options_.endorser_within) endpoints.own_endorser = fmt::format("127.0.0.1:{}", free_port());
  Proxied proxied;
  if (options_.proxy) {
    if (auto s = start_proxy(endpoints, proxied); !s) return s;
  }
  if (auto s = write_configs(files_, options_, endpoints, proxied); !s) return s;
  return enroll_and_acquire();
}

// Before anything is asked of the ledger: who holds a drone is named, with the cure, in place of the contract's
// refusal.
Status FlightLedger::check_leases(const deployment::OwnLedger& network) {
  const auto self = crypto::load_identity(crypto::Library::libcrypto, network.ground_msp_id, network.ground_files);
  if (!self) return self.error();
  if (auto s = programs_.run_to_end(records_program, {"--config", files_.config("operator"), "show", "--json"}); !s)
    return s;
  if (auto s = preflight_.read_records(records_, self->name); !s) return s;
  return preflight_.leases_fit();
}

Status FlightLedger::enroll_and_acquire() {
  const deployment::OwnLedger* network = is_of_others(options_) ? &*options_.own->network : nullptr;
  if (network) {
    if (auto s = check_leases(*network); !s) return s;
  }
  crypto::IdentityFiles host;
  if (network) {
    host = network->agent_files;
  } else {
    auto files = crypto::identity_files(user_dir(files_, 1, "User1") + "/msp");
    if (!files) return files.error();
    host = std::move(*files);
  }
  std::vector<std::string> enroll{
      "--config", files_.config("admin"), "enroll", "--msp", network ? network->agent_msp_id : "Org1MSP",
      "--cert",   host.certificate};
  std::vector<std::string> acquire{"--config", files_.config("operator"), "acquire"};
  bool acquires = false;
  for (const std::string& name : drone_names(options_)) {
    enroll.push_back(name);
    if (!preflight_.acquires(name)) continue;
    acquire.push_back(name);
    acquires = true;
  }
  if (!network || !network->admin.empty()) {
    if (auto s = programs_.run_to_end("control-enroll", enroll); !s) return s;
  }
  if (!options_.operators.empty()) return enroll_operators();
  if (acquires) {
    // Before: a Ctrl-C does not wait for the call, which may be on its way to the ledger.
    if (network)
      std::ranges::copy_if(drone_names(options_), std::back_inserter(acquired_), [this](const std::string& name) {
        return preflight_.acquires(name) && !preflight_.is_held(name);
      });
    if (auto s = programs_.run_to_end("control-acquire", acquire); !s) {
      if (!programs_.is_running("control-acquire")) acquired_.clear();  // refused
      return s;
    }
  }
  preflight_.acquired();
  return done;
}

void FlightLedger::give_back() {
  if (acquired_.empty()) return;
  // One that Ctrl-C did not wait for comes first, or it would take them again.
  for (const TimeNs until_ns = monotonic_ns() + acquire_limit_ns;
       programs_.is_running("control-acquire") && monotonic_ns() < until_ns;)
    programs_.poll(50 * ns_per_ms);
  std::vector<std::string> release{"--config", files_.config("operator"), "release"};
  release.insert(release.end(), acquired_.begin(), acquired_.end());
  const Status given = programs_.run_after_flight("control-release", release);
  if (!given)
    live_.print(fmt::format("Not given back: the lease of {}; `ledgerline control --config {} release` does. {}",
                            fmt::join(acquired_, ", "), files_.config("operator"), given.error().message));
  acquired_.clear();
}

// They take their drones at the page.
Status FlightLedger::enroll_operators() {
  const auto made = make_operators(files_, options_.operators);
  if (!made) return made.error();
  for (const MadeOperator& one : *made) {
    if (auto s = programs_.run_to_end("control-" + one.name,
                                      {"--config", files_.config("operators-admin"), "enroll", "--msp", "Org2MSP",
                                       "--cert", one.certificate, "--role", "operator"});
        !s)
      return s;
    live_.print(fmt::format("Operator {}: pass phrase {}", one.name, one.pass_phrase));
  }
  return done;
}

Status FlightLedger::start_endorser(LedgerEndpoints& endpoints) {
  if (auto s = write_endorser_config(files_, endpoints); !s) return s;
  if (auto s = programs_.start("endorser", {files_.config("endorser")}); !s) return s;
  if (auto s = programs_.wait_ready({"endorser"}); !s) return s;
  const json ready = json::parse(programs_.ready_line("endorser"));
  endpoints.own_endorser = ready.value("endpoint", "");
  if (endpoints.own_endorser.empty())
    return Error{"the endorser did not say where it listens: " + programs_.ready_line("endorser")};
  return done;
}

Status FlightLedger::start_proxy(const LedgerEndpoints& endpoints, Proxied& proxied) {
  if (auto s = write_proxy_config(files_, options_, endpoints); !s) return s;
  std::vector<std::string> arguments{"proxy", "--config", files_.config(proxy_name)};
  if (!options_.faults.empty()) arguments.insert(arguments.end(), {"--script", options_.faults});
  if (auto s = programs_.start(proxy_name, std::move(arguments)); !s) return s;
  if (auto s = programs_.wait_ready({proxy_name}); !s) return s;
  const json ready = json::parse(programs_.ready_line(proxy_name));
  const json servers = ready.value("servers", json());
  for (const auto& [name, address] : servers.items()) {
    if (address.is_string()) proxied[name] = address.get<std::string>();
  }
  if (!proxied.contains("agent") || !proxied.contains("ground"))
    return Error{"the proxy did not say where it listens: " + programs_.ready_line(proxy_name)};
  if (!options_.fault_switches) return done;
  auto switches = SwitchService::open(files_.fault_switches(), files_.proxy_faults(), drone_names(options_));
  if (!switches) return switches.error();
  switches_ = std::move(*switches);
  return done;
}

}  // namespace ledgerline::launcher
