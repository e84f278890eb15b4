#include "chaincode/network/network.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <ifaddrs.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/file.h>
#include <unistd.h>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/options.hpp"
#include "chaincode/network/setup/deployment.hpp"
#include "chaincode/network/setup/site.hpp"
#include "common/base/file.hpp"

namespace ledgerline::network {

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using Step = std::function<Status()>;

Status in_order(const std::vector<Step>& steps) {
  for (const Step& step : steps) {
    if (Status s = step(); !s) return s;
  }
  return done;
}

struct Service {
  std::string name;
  pid_t pid = 0;
};

std::vector<Service> services_of(const json& running) {
  std::vector<Service> services;
  for (const json& one : running.value("processes", json::array())) {
    const std::string name = one.value("name", "");
    if (name.starts_with("chaincode")) services.push_back({name, one.value("pid", 0)});
  }
  return services;
}

/// What the running network says of itself, in place of what a command line would.
Status apply_running(Options& options, const json& running, const std::vector<Service>& services) {
  options.channels = running.at("channels").get<std::vector<std::string>>();
  options.orderers = static_cast<int>(running.at("orderers").size());
  if (services.size() == identities::organisations) return done;
  for (const json& one : running.at("processes")) {
    const std::string name = one.value("name", "");
    if (name.starts_with("orderer")) options.only.push_back(name);
    if (name.starts_with("peer")) options.only.push_back("org" + name.substr(4));
  }
  for (const auto& [key, addresses] :
       {std::pair{"orderers", &options.orderer_addresses}, std::pair{"peers", &options.organisation_addresses}}) {
    if (Status s = parse_listen_addresses(running.at(key).get<std::vector<std::string>>(), *addresses); !s) return s;
  }
  return done;
}

bool runs(const Service& service, const std::string& program) {
  std::error_code error;
  return fs::equivalent(fmt::format("/proc/{}/exe", service.pid), program, error);
}

/// The file that the network's process starts it from.
Status check_command(const Service& service, const std::string& program) {
  const auto command = read_file(fmt::format("/proc/{}/cmdline", service.pid));
  const std::string file = command ? command->substr(0, command->find('\0')) : "";
  std::error_code error;
  if (fs::equivalent(file, program, error)) return done;
  return Error{
      fmt::format("{} is started from {}, not from {}: put this version's programs in the place of those, or end the "
                  "network and start it with this one",
                  service.name, file, program)};
}

/// Ends those that run another program, and waits until the network's process has restarted them.
Status renew(Site& site, const RunFile& file, const std::vector<Service>& services) {
  const std::string& program = site.options().chaincode;
  for (const Service& service : services) {
    if (!runs(service, program)) ::kill(service.pid, SIGTERM);
  }
  const TimeNs until = monotonic_ns() + starting_limit_ns;
  for (;;) {
    const auto running = file.read();
    if (!running) return Error{"the network has ended"};
    std::string missing;
    for (const Service& service : services_of(*running)) {
      if (service.pid <= 0 || !runs(service, program)) missing = service.name;
    }
    if (missing.empty()) return done;
    if (monotonic_ns() > until) return Error{missing + " does not come back as the new program"};
    if (Status s = site.poll(10 * ns_per_ms); !s) return s;
  }
}

}  // namespace

Status Network::prepare() {
  return in_order({[&] { return site_.open(); }, [&] { return make_crypto_material(site_); },
                   [&] { return make_first_blocks(site_); }});
}

Status Network::up() {
  const Status set_up =
      in_order({[&] { return check_own_address(); }, [&] { return check_room(); }, [&] { return prepare(); },
                [&] { return check_free(site_.addresses().bound(site_.options())); },
                [&] { return deployment_.make_packages(); }, [&] { return start_orderers_and_peers(); },
                [&] { return join_orderers(site_); }, [&] { return join_peers(site_); },
                [&] { return deployment_.start_services(); }, [&] { return deployment_.install(); },
                [&] { return deployment_.define(); }, [&] { return deployment_.wait_for_contract(); },
                [&] { return deployment_.wait_for_endorsers(); }, [&] { return deployment_.enroll_first(); }});
  if (!set_up) return set_up;
  site_.processes().supervise();
  return wait_for_leader(site_);
}

/// Whatever its settings say, a peer looks for an IPv4 address outside 127.0.0.0/8 when it starts, and ends without one
/// (Fabric's getLocalAddress, core/peer/config.go); it does not use what it finds.
Status Network::check_own_address() {
  ifaddrs* all = nullptr;
  if (site_.own_organisations().empty() || ::getifaddrs(&all) != 0) return done;
  bool found = false;
  for (const ifaddrs* i = all; i; i = i->ifa_next) {
    if (!i->ifa_addr || i->ifa_addr->sa_family != AF_INET) continue;
    const in_addr_t address = ntohl(reinterpret_cast<const sockaddr_in*>(i->ifa_addr)->sin_addr.s_addr);
    found = found || address >> IN_CLASSA_NSHIFT != IN_LOOPBACKNET;
  }
  ::freeifaddrs(all);
  if (found) return done;
  return Error{
      "this host has no IPv4 address but loopback's, and Fabric's peers do not start without one, though they need no "
      "network: as root, `ip addr add 10.255.255.1/32 dev lo`"};
}

/// Each orderer makes two files of 64 MB for each channel beforehand; some more is for what is written later. What the
/// directory has already is not needed again.
Status Network::check_room() {
  constexpr std::uint64_t orderer_channel = 128ULL << 20, more = 64ULL << 20;
  const std::uint64_t all = site_.own_orderers().size() * site_.options().channels.size() * orderer_channel + more;
  const std::uint64_t there = bytes_below(site_.options().dir);
  return check_space(site_.options().dir, std::max(all - std::min(all, there), more), "the network");
}

Status Network::start_orderers_and_peers() {
  for (const int k : site_.own_orderers()) {
    if (Status s = site_.processes().start(
            fmt::format("orderer{}", k), site_.addresses().orderer(k), {site_.tool("orderer")},
            orderer_environment(site_.options(), site_.addresses(), k), site_.options().orderer_scheduling());
        !s) {
      return s;
    }
  }
  // Peers take a moment to start; meanwhile the orderers are asked to join.
  for (const int k : site_.own_organisations()) {
    if (Status s = site_.processes().start(
            fmt::format("peer{}", k), site_.addresses().peer(k), {site_.tool("peer"), "node", "start"},
            peer_environment(site_.options(), site_.addresses(), k), site_.options().organisation_scheduling(k));
        !s) {
      return s;
    }
  }
  return done;
}

Status upgrade(Options options) {
  const RunFile file(options.dir);
  const auto running = file.read();
  if (!running || !running->contains("processes")) {
    return Error{"no network runs in " + options.dir + "; `up` brings one that is down to this version's contract"};
  }
  const auto services = services_of(*running);
  for (const Service& service : services) {
    if (service.pid <= 0) return Error{service.name + " is just starting; try again"};
    if (Status s = check_command(service, options.chaincode); !s) return s;
  }
  if (Status s = apply_running(options, *running, services); !s) return s;
  Site site(std::move(options));
  if (Status s = site.open(); !s) return s;
  Deployment deployment(site);
  Status status = deployment.make_packages();
  if (status) status = deployment.define();
  if (status && !site.options().runs_organisation(1)) status = deployment.wait_for_definition();
  if (status) status = renew(site, file, services);
  return status ? deployment.wait_for_contract() : status;
}

RunFile::~RunFile() {
  if (fd_ >= 0) ::close(fd_);
}

bool RunFile::lock() {
  fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd_ < 0 || ::flock(fd_, LOCK_EX | LOCK_NB) != 0) return false;
  return write("");
}

bool RunFile::write(const std::string& text) const {
  return ::ftruncate(fd_, 0) == 0 && ::pwrite(fd_, text.data(), text.size(), 0) == static_cast<ssize_t>(text.size());
}

std::optional<nlohmann::json> RunFile::read() const {
  nlohmann::json json;
  // It may be writing just now.
  for (int tries = 0; tries < 5 && !json.is_object(); ++tries) {
    if (tries > 0) ::usleep(10'000);
    const int fd = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return std::nullopt;
    const bool held = ::flock(fd, LOCK_SH | LOCK_NB) != 0;
    ::close(fd);
    if (!held) return std::nullopt;
    std::ifstream in(path_);
    json = nlohmann::json::parse(in, nullptr, false);
  }
  return json.is_object() ? json : nlohmann::json::object();
}

}  // namespace ledgerline::network
