#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "chaincode/identities/identities.hpp"
#include "chaincode/network/files/authority.hpp"
#include "chaincode/network/network.hpp"
#include "chaincode/network/options.hpp"
#include "chaincode/network/processes/orderer_watch.hpp"
#include "chaincode/node/storage/files.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"

namespace {

using namespace ledgerline;
using network::Network;
using network::Options;
using network::RunFile;

constexpr const char* about =
    "A Fabric 2.5 network on this host, or this host's part of one, with Ledgerline's contract on it";
constexpr const char* notes = R"(Examples:
  ledgerline fabric up --dir /tmp/net                       three organisations, one orderer; returns when the contract answers
  ledgerline fabric up --dir /tmp/net3 --orderers 3 --batch-count 10 --batch-timeout 5 --channel teleop --channel yard
  ledgerline fabric status --dir /tmp/net                   every process: where it listens, pid, restarts; who leads
  ledgerline fabric logs --dir /tmp/net peer1
  ledgerline fabric up --dir /tmp/netca --ca                identities from fabric-ca, one server an organisation
  ledgerline fabric revoke --dir /tmp/netca --org 2 --user User1
  ledgerline fabric revoke --dir /tmp/netca --org 2 --certificate stolen.pem
  ledgerline fabric upgrade --dir /tmp/net                  after an update: this version's contract, while drones fly
  ledgerline fabric down --dir /tmp/net                     ends it; the directory stays, and `up` goes on with it
  ledgerline fabric run --dir /tmp/net                      the same in the foreground, until SIGINT or SIGTERM
On three hosts (docs/fabric.md):
  ledgerline fabric identities --config net.toml --dir net  once: net/host-ADDRESS for each host, net/authority stays
  ledgerline fabric run --config net.toml --dir net --only org1 --only orderer1

A process of the network that ends is started again; when that does not help, the network ends and says why.
`run` prints {"ready":true,...} when it serves. Exit codes: 0 good, 1 failed, 2 wrong usage, 3 (status) it does not run.)";

nlohmann::json describe(const Network& network) {
  const Options& options = network.options();
  nlohmann::json peers = nlohmann::json::array(), orderers = nlohmann::json::array(),
                 processes = nlohmann::json::array();
  std::string endpoint;
  for (int k = 1; k <= identities::organisations; ++k) {
    peers.push_back(network.addresses().peer(k));
    if (endpoint.empty() && options.runs_organisation(k)) endpoint = network.addresses().peer(k);
  }
  for (int k = 1; k <= options.orderers; ++k) orderers.push_back(network.addresses().orderer(k));
  nlohmann::json authorities = nlohmann::json::array();
  for (std::size_t k = 0; k < network.addresses().authorities.size(); ++k) {
    authorities.push_back(network.addresses().authority(static_cast<int>(k)));
  }
  for (const auto& one : network.processes()) {
    processes.push_back({{"name", one.name}, {"address", one.address}, {"pid", one.pid}, {"restarts", one.restarts}});
    if (one.name.starts_with("orderer")) {
      processes.back()["operations"] = network.addresses().orderer_operations(std::stoi(one.name.substr(7)));
    }
  }
  return {{"ready", true},
          {"endpoint", endpoint},
          {"peers", peers},
          {"orderers", orderers},
          {"authorities", authorities},
          {"process", ::getpid()},
          {"channel", options.channels.front()},
          {"channels", options.channels},
          {"processes", processes}};
}

Status write_summary(const std::string& path, Network& network) {
  const auto counts = network.count();
  if (!counts) return counts.error();
  const auto storage = node::storage_kind(network.options().dir);
  if (!storage) return storage.error();
  nlohmann::json cpu = nlohmann::json::object(), restarts = nlohmann::json::object();
  for (const auto& one : network.processes()) {
    cpu[one.name] = one.cpu_s;
    restarts[one.name] = one.restarts;
  }
  const nlohmann::json summary{{"blocks", counts->blocks},
                               {"transactions", counts->transactions},
                               {"storage", *storage},
                               {"cpu_seconds", cpu},
                               {"restarts", restarts}};
  return write_file(path, summary.dump(2) + "\n");
}

/// Until SIGINT or SIGTERM. `ready`: called once.
int run(const Options& options, const std::string& summary, const std::function<void(const std::string&)>& ready) {
  std::error_code error;
  std::filesystem::create_directories(options.dir, error);
  RunFile file(options.dir);
  if (!file.lock())
    return fail(Error{"a network runs in " + options.dir + " already, or the directory cannot be written"});
  catch_stop_signals();
  ::signal(SIGPIPE, SIG_IGN);
  Network network(options);
  const TimeNs begin = monotonic_ns();
  Status status = network.up();
  if (status) {
    spdlog::info("up after {:.1f} s", to_seconds(monotonic_ns() - begin));
    std::string text, said;
    while (status && !stop_requested) {
      text = describe(network).dump();
      if (text != said && !file.write(text)) status = Error{"cannot write " + options.dir + "/network.json"};
      if (said.empty() && status) ready(text);
      said = text;
      if (status) status = network.poll(200 * ns_per_ms);
    }
  }
  Status written = done;
  if (status && !summary.empty()) written = write_summary(summary, network);
  const bool in_time = network.down();
  if (!written) return fail(written.error());
  if (!status) return fail(status.error());
  return in_time ? 0 : fail(Error{"a process had to be killed"});
}

/// In the background; returns when it serves, or with what went wrong.
int up(const Options& options) {
  if (const auto running = RunFile(options.dir).read()) {
    print_line(running->dump());
    return 0;
  }
  int pipe[2];
  if (::pipe(pipe) != 0) return fail(Error{"no pipe"});
  std::error_code error;
  std::filesystem::create_directories(options.dir, error);
  const std::string log_file = options.dir + "/network.log";
  const auto logged_before = std::filesystem::file_size(log_file, error);
  const bool fresh_log = static_cast<bool>(error);
  const pid_t child = ::fork();
  if (child == 0) {
    ::setsid();
    ::close(pipe[0]);
    const int log = ::open(log_file.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644);
    const int nothing = ::open("/dev/null", O_RDWR);
    if (log < 0 || nothing < 0) ::_exit(1);
    ::dup2(nothing, 0);
    ::dup2(nothing, 1);
    ::dup2(log, 2);
    ::fcntl(pipe[1], F_SETFD, FD_CLOEXEC);
    ::_exit(run(options, {}, [&](const std::string& text) {
      (void)!::write(pipe[1], text.data(), text.size());
      ::close(pipe[1]);
    }));
  }
  ::close(pipe[1]);
  std::string text;
  char part[4096];
  for (ssize_t n; (n = ::read(pipe[0], part, sizeof part)) > 0;) text.append(part, static_cast<std::size_t>(n));
  if (child < 0 || text.empty()) {
    // What it logged this time ends with what went wrong.
    std::ifstream log(log_file);
    log.seekg(fresh_log ? 0 : static_cast<std::streamoff>(logged_before));
    for (std::string line; std::getline(log, line);) std::fprintf(stderr, "%s\n", line.c_str());
    return fail(Error{"the network did not start; all of its log is in " + log_file});
  }
  print_line(text);
  return 0;
}

int down(const std::string& dir) {
  const RunFile file(dir);
  const auto running = file.read();
  if (!running) {
    std::printf("no network runs in %s\n", dir.c_str());
    return 0;
  }
  const pid_t process = running->value("process", 0);
  if (process <= 0) return fail(Error{"the network in " + dir + " is just starting; try again"});
  ::kill(process, SIGTERM);
  constexpr int tries = 400;
  for (int i = 0; i < tries && file.read(); ++i) ::usleep(50'000);
  return file.read() ? fail(Error{fmt::format("process {} does not end", process)}) : 0;
}

/// Who leads is asked now; none may for a moment.
void add_leads(nlohmann::json& running) {
  for (auto& process : running["processes"]) {
    if (!process.contains("operations") || process.value("pid", 0) <= 0) continue;
    const auto metrics = network::fetch_metrics(process["operations"].get<std::string>());
    process["leads"] = nlohmann::json::array();
    if (!metrics) continue;
    for (const auto& [channel, sign] : network::raft_signs(*metrics)) {
      if (sign.leads) process["leads"].push_back(channel);
    }
  }
}

int status(const std::string& dir) {
  auto running = RunFile(dir).read();
  if (running && running->contains("processes")) add_leads(*running);
  std::printf("%s\n", running ? running->dump(2).c_str() : "it does not run");
  return running ? 0 : 3;
}

int logs(const std::string& dir, const std::string& which) {
  const std::string path = which.empty() ? dir + "/network.log" : dir + "/logs/" + which + ".log";
  std::ifstream in(path);
  if (!in) return fail(Error{"there is no " + path});
  for (std::string line; std::getline(in, line);) print_line(line);
  return 0;
}

/// All of it in DIR/authority, and of that a folder DIR/host-ADDRESS for each host.
int make_identities(Options options) {
  const std::string all = options.dir;
  const auto hosts = network::hosts_of(options);
  if (hosts.empty()) {
    return fail(
        Error{"identities are for several hosts: give all addresses, as [[organisation]] and [[orderer]] in a file"},
        exit_usage);
  }
  options.dir = all + "/authority";
  Network network(options);
  if (const Status status = network.prepare(); !status) return fail(status.error());
  for (const auto& host : hosts) {
    const std::string to = all + "/host-" + host.host;
    if (const Status s = network::write_host(network.options().dir, host, options, to); !s) {
      return fail(s.error());
    }
    std::printf("%s is for %s alone\n", to.c_str(), host.host.c_str());
  }
  std::printf("%s stays here: it has the authorities' keys and the orderers' administrator's\n", options.dir.c_str());
  return network.down() ? 0 : fail(Error{"a process had to be killed"});
}

/// What a command line asks for.
struct VerbOptions {
  Options options;
  double batch_timeout_ms = to_ms(options.batch_timeout_ns);
  std::vector<std::string> organisations, orderers;
  std::string config, summary, process, user, certificate, list;
  int organisation = 0;
};

/// Takes a user of a running network out of it, or one of its certificates, or whom a list names.
int revoke(const VerbOptions& verb_options) {
  Options options = verb_options.options;
  const auto running = RunFile(options.dir).read();
  if (!running || !running->contains("authorities")) return fail(Error{"no network runs in " + options.dir});
  options.dir = std::filesystem::canonical(options.dir);
  options.channels = (*running)["channels"].get<std::vector<std::string>>();
  network::ListenAddresses addresses;
  for (const auto& [name, all] : {std::pair{"orderers", &addresses.orderers},
                                  {"peers", &addresses.organisations},
                                  {"authorities", &addresses.authorities}}) {
    if (Status s = network::parse_listen_addresses((*running)[name].get<std::vector<std::string>>(), *all); !s)
      return fail(s.error());
  }
  const int organisation = verb_options.organisation;
  if (!verb_options.list.empty()) {
    const auto list = network::read_list(options, organisation, verb_options.list);
    if (!list) return fail(list.error());
    if (Status s = network::publish_list(options, addresses, organisation, *list); !s) return fail(s.error());
    std::printf("whom %s names is revoked in organisation %d\n", verb_options.list.c_str(), organisation);
    return 0;
  }
  network::Revoked revoked{verb_options.user};
  if (!verb_options.certificate.empty()) {
    auto pem = crypto::read_certificate_file(verb_options.certificate);
    if (!pem) return fail(pem.error());
    revoked.certificate_pem = std::move(*pem);
  }
  if (Status s = network::revoke(options, addresses, organisation, revoked); !s) return fail(s.error());
  if (verb_options.user.empty()) {
    std::printf("the certificate in %s is revoked in organisation %d\n", verb_options.certificate.c_str(),
                organisation);
  } else {
    std::printf("%s of organisation %d is revoked\n", verb_options.user.c_str(), organisation);
  }
  return 0;
}

/// To this version's contract.
int renew(const Options& options) {
  if (Status s = network::upgrade(options); !s) return fail(s.error());
  std::printf("the network in %s has this version's contract\n", options.dir.c_str());
  return 0;
}

/// Beside this program; the tools where scripts/fabric-tools puts them.
void find_programs(Options& options) {
  options.chaincode = build_or_prefix() / "bin/ledgerline-chaincode";
  if (options.tools.empty()) options.tools = build_or_prefix().parent_path() / "fabric";
}

Status add_places(Options& options, const std::vector<std::string>& organisations,
                  const std::vector<std::string>& orderers) {
  for (const auto& [texts, addresses] :
       {std::pair{&organisations, &options.organisation_addresses}, std::pair{&orderers, &options.orderer_addresses}}) {
    if (texts->empty()) continue;
    if (Status s = network::parse_listen_addresses(*texts, *addresses); !s) return s;
  }
  if (!options.orderer_addresses.empty()) options.orderers = static_cast<int>(options.orderer_addresses.size());
  return network::check(options);
}

void add_network_options(Verb verb, VerbOptions& verb_options) {
  Options& options = verb_options.options;
  verb.option("--config", verb_options.config, "TOML file with the network's settings; options here come before it");
  verb.option("--orderers", options.orderers, "1 or 3").one_of({1, 3}).shows_default();
  verb.option("--channel", options.channels, "A channel's name; give it again for more")
      .one_at_a_time()
      .shows_default();
  verb.option("--drone", options.drones, "A drone that is enrolled first; more than once; none: tello1 to tello16")
      .one_at_a_time();
  verb.option("--first-port", options.first_port, "The first of the TCP ports, 3 a part; 0 looks for free ones")
      .shows_default();
  verb.option("--organisation", verb_options.organisations, "HOST:PORT of one; three times, for several hosts")
      .one_at_a_time();
  verb.option("--orderer", verb_options.orderers, "HOST:PORT of one, once or three times").one_at_a_time();
  verb.option("--only", options.only, "A part that this host runs: org1, orderer1, ...; all if none is named")
      .one_at_a_time();
  verb.option("--background", options.background,
              "An organisation for whom nobody on this host waits, org1, ...: peer and chaincode run at nice 19")
      .one_at_a_time();
  verb.flag("--short-slices", options.short_slices, "All other parts run in slices of 0.1 ms (Linux 6.12)");
  verb.option("--batch-timeout", verb_options.batch_timeout_ms, "Cut a block after this many ms")
      .within(1.0, 60'000.0)
      .shows_default();
  verb.option("--batch-count", options.batch_count, "or with this many transactions").within(1, 10'000).shows_default();
  verb.flag("--ca", options.ca, "Identities from fabric-ca, one server an organisation, that can be revoked");
  verb.flag("!--no-history", options.history, "This host's peers keep no history database: `history` fails there");
  verb.option("--signature-policy", options.signature_policy,
              "Of the contract's definition; none: a majority endorses");
}

std::vector<Verb> add_verbs(CommandLine& line, VerbOptions& verb_options) {
  std::vector<Verb> verbs;
  const auto add = [&](const std::string& name, const std::string& about) {
    Verb verb = line.verb(name, about);
    verb.option("--dir", verb_options.options.dir, "Everything of the network: identities, ledgers, logs")
        .required()
        .utf8_path();
    verbs.push_back(verb);
    return verb;
  };
  const auto add_with_tools = [&](const std::string& name, const std::string& about) {
    Verb verb = add(name, about);
    verb.option("--tools", verb_options.options.tools, "Fabric's programs, made by scripts/fabric-tools");
    return verb;
  };
  add_network_options(add_with_tools("up", "Start it, or say that it runs"), verb_options);
  Verb run = add_with_tools("run", "Start it and stay");
  add_network_options(run, verb_options);
  run.option("--summary", verb_options.summary, "Write blocks, transactions, CPU times and restarts here at the end");
  add_network_options(add_with_tools("identities", "Make identities and first blocks for several hosts, a folder each"),
                      verb_options);
  add("down", "End it");
  add("status", "Does it run, and where");
  add("logs", "What it or one of its processes logged")
      .option("process", verb_options.process, "peer1, orderer1, chaincode1, ...");
  add_with_tools("upgrade", "Bring a running network, or this host's part, to this version's contract");
  Verb revoke = add_with_tools("revoke", "Take a user or an endorser out: peers refuse it from then on");
  revoke.option("--org", verb_options.organisation, "Number of the user's organisation")
      .required()
      .within(1, identities::organisations);
  revoke.option("--user", verb_options.user,
                "User1, ... or endorser0, of a network with --ca: all certificates that it has");
  revoke
      .option("--certificate", verb_options.certificate,
              "In place of --user: one certificate (PEM); a renewed one of the same user goes on")
      .existing_file();
  revoke
      .option("--list", verb_options.list,
              "In place of --user: a revocation list (PEM) of its authority, with all it revoked")
      .existing_file();
  return verbs;
}

/// The file first, and over it what the command line says. An exit code: the program ends.
std::optional<int> read_verb_options(CommandLine& line, int argc, char** argv, VerbOptions& verb_options) {
  if (const auto end = line.parse(argc, argv)) return end;
  if (!verb_options.config.empty()) {
    auto read = network::read_options(verb_options.config, {});
    if (!read) return fail(read.error(), exit_usage);
    verb_options.options = std::move(*read);
    verb_options.batch_timeout_ms = to_ms(verb_options.options.batch_timeout_ns);
    line.read({argv + 1, argv + argc});  // it was good before, and is again
  }
  verb_options.options.batch_timeout_ns = static_cast<TimeNs>(verb_options.batch_timeout_ms * ns_per_ms);
  return std::nullopt;
}

int carry_out(const std::string& verb, VerbOptions& verb_options) {
  Options& options = verb_options.options;
  if (verb == "down") return down(options.dir);
  if (verb == "status") return status(options.dir);
  if (verb == "logs") return logs(options.dir, verb_options.process);
  if (Status s = add_places(options, verb_options.organisations, verb_options.orderers); !s)
    return fail(s.error(), exit_usage);
  find_programs(options);
  if (verb == "revoke" &&
      !verb_options.user.empty() + !verb_options.certificate.empty() + !verb_options.list.empty() != 1)
    return fail(Error{"revoke: give one of --user, --certificate and --list"}, exit_usage);
  if (verb == "revoke") return revoke(verb_options);
  if (verb == "up") return up(options);
  if (verb == "upgrade") return renew(options);
  if (verb == "identities") return make_identities(options);
  return run(options, verb_options.summary, print_line);
}

}  // namespace

int ledgerline::command::fabric(int argc, char** argv) {
  ::umask(077);  // of all children, too: keys, archives and what Fabric's programs write are this user's alone
  CommandLine line("ledgerline fabric", about, notes);
  VerbOptions verb_options;
  const std::vector<Verb> verbs = add_verbs(line, verb_options);
  if (const auto end = read_verb_options(line, argc, argv, verb_options)) return *end;
  const auto given = std::find_if(verbs.begin(), verbs.end(), [](const Verb& verb) { return verb.is_given(); });
  return carry_out(given->name(), verb_options);
}
