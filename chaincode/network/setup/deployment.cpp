#include "chaincode/network/setup/deployment.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "chaincode/identities/identities.hpp"
#include "chaincode/lifecycle/lifecycle.hpp"
#include "chaincode/network/options.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::network {
namespace {

namespace fs = std::filesystem;

constexpr const char* label = "ledgerline_1";  // of the package, which says where the service is and stays the same
// Peers hear of each other once a second; those of hosts that are down are not waited for longer.
constexpr TimeNs endorsers_limit_ns = 30 * ns_per_s;

std::string first_file(const fs::path& dir) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(dir, error)) return entry.path();
  return dir;
}

}  // namespace

Status Deployment::make_package(int organisation) {
  const std::string package = site_.in(fmt::format("package{}/ledgerline.tgz", organisation));
  if (!fs::exists(package)) {
    const auto ca = read_file(identities::peer_dir(site_.options().dir, organisation) / "tls" / "ca.crt");
    if (!ca) return ca.error();
    if (Status s = replace_file(
            package, chaincode_lifecycle::make_package(label, connection_json(site_.addresses(), organisation, *ca)),
            0600);
        !s)
      return s;
  }
  const auto bytes = read_file(package);
  if (!bytes) return bytes.error();
  package_ids_[organisation] = chaincode_lifecycle::package_id(label, *bytes);
  return done;
}

Status Deployment::make_packages() {
  for (const int k : site_.own_organisations()) {
    if (Status s = make_package(k); !s) return s;
  }
  return done;
}

Status Deployment::start_services() {
  for (const int k : site_.own_organisations()) {
    if (Status s = site_.processes().start(
            fmt::format("chaincode{}", k), site_.addresses().chaincode(k), {site_.options().chaincode},
            chaincode_environment(site_.options(), site_.addresses(), k, package_ids_[k]),
            site_.options().organisation_scheduling(k));
        !s) {
      return s;
    }
  }
  const TimeNs until = monotonic_ns() + starting_limit_ns;
  for (const int k : site_.own_organisations()) {
    while (!site_.processes().has_printed(fmt::format("chaincode{}", k), "\"ready\":true")) {
      if (Status s = site_.poll(10 * ns_per_ms); !s) return s;
      if (monotonic_ns() > until) return Error{fmt::format("chaincode{} is not ready", k)};
    }
  }
  return done;
}

Status Deployment::install() {
  return site_.once("installed", [&]() -> Status {
    for (const int k : site_.own_organisations()) {
      const std::string package = site_.in(fmt::format("package{}/ledgerline.tgz", k));
      if (Status s = site_.call_peer(fmt::format("installing the contract on peer {}", k), k,
                                     {"lifecycle", "chaincode", "install", package}, "already successfully installed");
          !s) {
        return s;
      }
    }
    return done;
  });
}

std::vector<std::string> Deployment::lifecycle(const std::string& verb, const std::string& channel, int sequence,
                                               const std::vector<std::string>& more) const {
  std::vector<std::string> words{"lifecycle", "chaincode", verb};
  words.insert(words.end(), more.begin(), more.end());
  words.insert(words.end(),
               {"-o", site_.addresses().orderer(1), "--tls", "--cafile",
                identities::orderer_dir(site_.options().dir, 1) / "tls" / "ca.crt", "--channelID", channel, "--name",
                "ledgerline", "--version", contract::version, "--sequence", std::to_string(sequence)});
  // Without one the channel's holds, /Channel/Application/Endorsement: a majority of its organisations.
  if (!site_.options().signature_policy.empty())
    words.insert(words.end(), {"--signature-policy", site_.options().signature_policy});
  return words;
}

Status Deployment::approve(const std::string& channel, int organisation, int sequence) {
  return site_.call_peer(fmt::format("organisation {} approving the contract on channel {}", organisation, channel),
                         organisation,
                         lifecycle("approveformyorg", channel, sequence,
                                   {"--package-id", package_ids_[organisation], "--waitForEventTimeout", "10s"}),
                         "unchanged content");
}

Status Deployment::commit(const std::string& channel, int sequence) {
  std::vector<std::string> words = lifecycle("commit", channel, sequence);
  for (int k = 1; k <= identities::organisations; ++k) {
    words.insert(words.end(), {"--peerAddresses", site_.addresses().peer(k), "--tlsRootCertFiles",
                               identities::peer_dir(site_.options().dir, k) / "tls" / "ca.crt"});
  }
  return site_.call_peer("committing the contract on channel " + channel, 1, words,
                         fmt::format("new definition must be sequence {}", sequence + 1));
}

Result<Deployment::Definition> Deployment::definition_on(const std::string& channel) {
  const int organisation = site_.own_organisations().front();
  const std::vector<std::string> command{site_.tool("peer"), "lifecycle", "chaincode", "querycommitted",
                                         "--channelID",      channel,     "--name",    "ledgerline",
                                         "--output",         "json"};
  const auto ask = [&] {
    return site_.processes().run("asking for the contract's definition on channel " + channel, command,
                                 admin_environment(site_.options(), site_.addresses(), organisation));
  };
  auto printed = ask();
  for (const TimeNs until = monotonic_ns() + site_.timeout(); !printed && monotonic_ns() < until; printed = ask()) {
    if (Status s = site_.poll(ns_per_s / 10); !s) return s.error();
  }
  if (!printed) return printed.error();
  const auto said = nlohmann::json::parse(*printed, nullptr, false);
  if (!said.is_object() || !said.contains("sequence") || !said["sequence"].is_number_integer() ||
      !said.contains("version") || !said["version"].is_string()) {
    return Error{"the peer's answer is no definition: " + *printed};
  }
  return Definition{said["sequence"].get<int>(), said["version"].get<std::string>()};
}

Status Deployment::define() {
  for (const std::string& channel : site_.options().channels) {
    if (Status s = define_on(channel); !s) return s;
  }
  return done;
}

/// The directory keeps which version was defined; of the first one the mark is empty.
Status Deployment::define_on(const std::string& channel) {
  const std::string mark = site_.in("done/contract-" + channel);
  if (const auto defined = read_file(mark); defined && *defined == contract::version) return done;
  Definition now;
  if (fs::exists(mark)) {
    const auto found = definition_on(channel);
    if (!found) return found.error();
    now = *found;
  }
  const bool new_here = now.version != contract::version;  // else another host has committed it already
  const int sequence = now.sequence + (new_here ? 1 : 0);
  // One after the other: the command waits from the newest block on, and may miss its own beside others. Those are on
  // other hosts, and then it is soon asked again.
  for (const int k : site_.own_organisations()) {
    if (Status s = approve(channel, k, sequence); !s) return s;
  }
  if (new_here && site_.options().runs_organisation(1)) {
    if (Status s = commit(channel, sequence); !s) return s;
  }
  return write_file(mark, contract::version, 0644);
}

Status Deployment::wait_for_definition() {
  const TimeNs until = monotonic_ns() + site_.timeout();
  for (const std::string& channel : site_.options().channels) {
    for (;;) {
      const auto now = definition_on(channel);
      if (now && now->version == contract::version) break;
      if (monotonic_ns() > until) {
        return now ? Error{"channel " + channel +
                           " has the contract of before yet: the host of organisation 1 commits it"}
                   : now.error();
      }
      if (Status s = site_.poll(ns_per_s / 10); !s) return s;
    }
  }
  return done;
}

Status Deployment::wait_for_contract() {
  for (const std::string& channel : site_.options().channels) {
    for (const int k : site_.own_organisations()) {
      if (Status s =
              site_.call_peer(fmt::format("peer {} answering for the contract on channel {}", k, channel), k,
                              {"chaincode", "query", "-C", channel, "-n", "ledgerline", "-c", R"({"Args":["get"]})"});
          !s) {
        return s;
      }
    }
  }
  return done;
}

Status Deployment::wait_for_endorsers() {
  const TimeNs until = monotonic_ns() + endorsers_limit_ns;
  for (const std::string& channel : site_.options().channels) {
    for (const int k : site_.own_organisations()) {
      const auto client = site_.connect(k, channel);
      if (!client) return client.error();
      if (Status s = wait_for_endorser(**client, k, std::nullopt, until); !s) return s;
      for (const int other : site_.own_organisations()) {
        if (Status s = wait_for_endorser(**client, k, other, until); !s) return s;
      }
    }
  }
  return done;
}

Status Deployment::wait_for_endorser(fabric::Client& client, int k, std::optional<int> other, TimeNs until) {
  fabric::Call call{contract::set,
                    {nlohmann::json{{"id", identities::msp_id_of(k) + "/ready"}, {"msgType", "none"}}.dump()}};
  if (other) call.need = fabric::EndorsementNeed{.organisation = identities::msp_id_of(*other)};
  for (;;) {
    const Status found = client.endorsable(call);
    if (found) return done;
    if (monotonic_ns() > until) {
      spdlog::warn("peer {} does not find {} to endorse yet: {}", k,
                   other ? fmt::format("peer {}", *other) : "a majority", found.error().message);
      return done;
    }
    if (Status s = site_.poll(ns_per_s / 10); !s) return s;
  }
}

Status Deployment::enroll_first() {
  return site_.once_per_channel("enrolments", [&](const std::string& channel) { return enroll_first_on(channel); });
}

Status Deployment::enroll_first_on(const std::string& channel) {
  const TimeNs until = monotonic_ns() + site_.timeout();
  for (int k = 1; k <= identities::organisations; ++k) {
    if (!site_.options().runs_organisation(k)) continue;
    const auto pem = read_file(first_file(identities::user_dir(site_.options().dir, k, "User1") / "msp" / "signcerts"));
    if (!pem) return pem.error();
    const auto user = crypto::parse_certificate(*pem);
    if (!user) return user.error();
    const auto client = site_.connect(k, channel);
    if (!client) return client.error();
    for (const FirstCall& call : first_calls(k, {identities::msp_id_of(k), user->subject}, site_.options().drones)) {
      if (Status s = call_until(**client, call, until); !s) return s;
    }
  }
  return done;
}

Status Deployment::call_until(fabric::Client& client, const FirstCall& call, TimeNs until) {
  for (;;) {
    const auto outcome = client.submit_and_wait({call.function, {call.argument}});
    if (outcome.kind == fabric::Outcome::Kind::committed) return done;
    if (monotonic_ns() > until) return Error{fmt::format("the first {}: {}", call.function, outcome.message)};
    if (Status s = site_.poll(ns_per_s / 2); !s) return s;
  }
}

}  // namespace ledgerline::network
