#include "chaincode/network/setup/site.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/files/authority.hpp"
#include "chaincode/network/files/places.hpp"
#include "chaincode/network/files/texts.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"

namespace ledgerline::fabric_network {

namespace fs = std::filesystem;

Site::Site(Options options)
    : options_(std::move(options)), watch_(options_.channels, [this](int orderer) { return signs_of(orderer); }) {}

Status Site::open() {
  if (Status s = check(options_); !s) return s;
  for (const char* program :
       {"orderer", "peer", "configtxgen", "osnadmin", "config/core.yaml", "config/orderer.yaml"}) {
    if (fs::exists(options_.tools + "/" + program)) continue;
    return Error{fmt::format("{}/{} is missing: scripts/fabric-tools builds Fabric's programs (with Go 1.24 or newer)",
                             options_.tools, program)};
  }
  std::error_code error;
  fs::create_directories(in("logs"), error);
  if (error) return Error{"making " + in("logs") + ": " + error.message()};
  options_.dir = fs::canonical(options_.dir, error);
  if (error) return Error{"looking at " + options_.dir + ": " + error.message()};
  if (has_authorities(options_.dir)) {
    options_.ca = true;  // a network begun with them goes on with them
  } else if (options_.ca && fs::exists(in("crypto"))) {
    return Error{in("crypto") + " is not from fabric-ca: begin in an empty directory"};
  }
  processes_ = std::make_unique<Processes>(in("logs"));
  auto places = choose_places(options_);
  if (!places) return places.error();
  places_ = std::move(*places);
  return done;
}

std::vector<int> Site::own_organisations() const {
  std::vector<int> own;
  for (int k = 1; k <= identities::organisations; ++k) {
    if (options_.runs_organisation(k)) own.push_back(k);
  }
  return own;
}

std::vector<int> Site::own_orderers() const {
  std::vector<int> own;
  for (int k = 1; k <= options_.orderers; ++k) {
    if (options_.runs_orderer(k)) own.push_back(k);
  }
  return own;
}

Status Site::once(const std::string& name, const std::function<Status()>& step) {
  const std::string mark = in("done/" + name);
  if (fs::exists(mark)) return done;
  if (Status s = step(); !s) return s;
  return write_file(mark, "", 0644);
}

Status Site::once_per_channel(const std::string& name, const std::function<Status(const std::string&)>& step) {
  for (const std::string& channel : options_.channels) {
    if (Status s = once(name + "-" + channel, [&] { return step(channel); }); !s) return s;
  }
  return done;
}

Status Site::tend(TimeNs duration) {
  if (Status s = processes_->tend(duration); !s) return s;
  for (const std::string& name : watch_.update(monotonic_ns(), processes_->states())) {
    spdlog::warn("{} has not taken part in Raft for {:.0f} s since its start: it hangs, and is ended", name,
                 to_seconds(OrdererWatch::limit_ns));
    processes_->kill(name);
  }
  return done;
}

std::map<std::string, RaftSign> Site::signs_of(int orderer) const {
  const auto metrics = fetch_metrics(places_.orderer_operations(orderer));
  return metrics ? raft_signs(*metrics) : std::map<std::string, RaftSign>{};
}

Status Site::run_until_good(const std::string& what, const std::vector<std::string>& command,
                            const std::vector<std::string>& environment, const std::string& good_too) {
  return processes_->run_until_good(what, command, environment, timeout(), good_too);
}

Status Site::ask_peer(const std::string& what, int organisation, std::vector<std::string> words,
                      const std::string& good_too) {
  words.insert(words.begin(), tool("peer"));
  return run_until_good(what, words, admin_environment(options_, places_, organisation), good_too);
}

Result<std::unique_ptr<fabric::Client>> Site::connect(int organisation, const std::string& channel) const {
  fabric::ClientConfig config;
  config.endpoint = places_.peer(organisation);
  config.tls_ca_file = identities::peer_dir(options_.dir, organisation) / "tls" / "ca.crt";
  config.where.channel = channel;
  auto identity = crypto::load_identity(crypto::Library::libcrypto, identities::msp_id_of(organisation),
                                        identities::user_dir(options_.dir, organisation, "Admin") / "msp");
  if (!identity) return identity.error();
  config.identity = std::move(*identity);
  return fabric::Client::create(std::move(config));
}

}  // namespace ledgerline::fabric_network
