#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "chaincode/lifecycle/lifecycle.hpp"
#include "common/access/access.hpp"
#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/config/config.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/config.hpp"
#include "common/msg/contract.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/checks/core/ledger.hpp"
#include "tools/command/verbs.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::chaincode_lifecycle;

constexpr const char* about =
    "Ledgerline's contract on a Fabric network that is there already: the steps of Fabric's lifecycle, each in the "
    "name of\n"
    "an organisation's administrator. What is done already is said, and is no error.";
constexpr const char* notes = R"(Examples:
  ledgerline contract package --address cc.org1.example.com:9999 --tls-root cc-tlsca.pem --out ledgerline.tgz
  ledgerline contract install --config org1-admin.toml --package ledgerline.tgz     # each organisation, at each of its peers
  ledgerline contract approve --config org1-admin.toml --package ledgerline.tgz     # each organisation, once
  ledgerline contract commit  --config org1-admin.toml                              # one organisation, once
  ledgerline contract status  --config org1-admin.toml
  ledgerline contract approve --config org1-admin.toml --package ledgerline.tgz --print   # the peer's commands instead

--config names a TOML file with [ledger] as other programs have it, with the administrator's identity; in its place stand
--endpoint, --tls-ca, --msp-id, --msp-dir and so on. The service is started with the package's id:
  CHAINCODE_ID=ID CHAINCODE_SERVER_ADDRESS=0.0.0.0:9999 CHAINCODE_TLS_KEY=... CHAINCODE_TLS_CERT=... ledgerline-chaincode
Exit codes: 0 done, or done already; 1 failed, or of `status`: the service does not answer; 2 wrong usage.)";

struct Options {
  std::string config, endpoint, tls_ca, server_name, tls_certificate, tls_key, msp_id, msp_dir;
  std::string channel = "teleop", name = "ledgerline";
  std::string version = contract::version;
  std::uint64_t sequence = 0;
  std::string package, id;
  std::string label = "ledgerline_1", address, tls_root, client_certificate, client_key, out = "ledgerline.tgz";
  bool client_auth = false, print = false, json = false;
};

/// The options that stand in place of a file, as one.
constexpr const char* which_package = "which package? give --package FILE";
constexpr const char* install_first = ": `ledgerline contract install` does";

Result<Config> config_of(const Options& options) {
  std::string text = "[ledger]\n", problem;
  const auto line = [&](const char* key, const std::string& value) {
    if (problem.empty()) problem = utf8_path_problem(value);
    if (problem.empty() && !value.empty()) text += fmt::format("{} = {}\n", key, nlohmann::json(value).dump());
  };
  line("endpoint", options.endpoint);
  line("tls_ca", options.tls_ca);
  line("server_name", options.server_name);
  line("tls_certificate", options.tls_certificate);
  line("tls_key", options.tls_key);
  line("msp_id", options.msp_id);
  line("msp_dir", options.msp_dir);
  line("channel", options.channel);
  line("contract", options.name);
  if (!problem.empty()) return Error{problem};
  return Config::parse(text, "options");
}

Result<fabric::ClientConfig> client_of(const Options& options) {
  if (!options.config.empty()) return fabric::load_ledger_config(options.config);
  auto config = config_of(options);
  if (!config) return config.error();
  auto client = fabric::ledger_config(*config);
  if (Status s = config->finish(); !s) return s.error();
  return client;
}

/// What the peer calls this package that it has installed; empty: it has not. Its label is the package's own.
Result<std::string> installed_id(const std::string& bytes, Lifecycle& lifecycle) {
  const auto there = lifecycle.installed();
  if (!there) return there.error();
  for (const Installed& one : *there)
    if (one.package_id.ends_with(package_id("", bytes))) return one.package_id;
  return std::string();
}

/// Why this makes no sense for the verb; empty: it does.
std::string nonsense(const Options& options, const std::string& verb) {
  if (verb == "package") {
    if (!is_label(options.label)) return "--label: a-z, A-Z and 0-9, inside also _ . + -";
    if (Status s = check_endpoint(options.address); !s) return "--address " + s.error().message;
    if (options.client_certificate.empty() != options.client_key.empty())
      return "--client-certificate and --client-key belong together";
  }
  if (verb == "install" && options.package.empty()) return which_package;
  if (verb == "approve" && options.package.empty() && options.id.empty())
    return std::string(which_package) + ", or --package-id LABEL:HASH";
  return "";
}

Status make(const Options& options) {
  ServicePlace place{.address = options.address, .client_auth = options.client_auth || !options.client_key.empty()};
  const auto take = [](const std::string& path, std::string& into) -> Status {
    if (path.empty()) return done;
    auto text = crypto::read_certificate_file(path);
    if (!text) return text.error();
    if (text->find("PRIVATE KEY") != std::string::npos)
      return Error{path +
                   ": has a private key, and who may fetch the package would have it; give the certificate alone"};
    into = std::move(*text);
    return done;
  };
  Status read = take(options.tls_root, place.root_pem);
  if (read) read = take(options.client_certificate, place.client_pem);
  if (!read) return read;
  if (!options.client_key.empty()) {
    auto key = crypto::read_key_file(options.client_key);
    if (!key) return key.error();
    place.client_key_pem = std::move(*key);
  }
  const std::string package = make_package(options.label, connection_json(place));
  if (Status s = write_file(options.out, package, place.client_key_pem.empty() ? 0644 : 0600); !s) return s;
  fmt::print("{}\n", package_id(options.label, package));
  if (place.root_pem.empty())
    fmt::print(stderr,
               "without --tls-root peers call the service in the clear: a man in the middle can answer for it\n");
  if (!place.client_key_pem.empty())
    fmt::print(stderr, "the package holds the key of {}: anyone who may fetch it from a peer has the key\n",
               options.client_key);
  return done;
}

Status install(const Options& options, Lifecycle& lifecycle) {
  const auto bytes = read_file(options.package);
  if (!bytes) return bytes.error();
  auto id = installed_id(*bytes, lifecycle);
  if (!id) return id.error();
  if (!id->empty()) {
    fmt::print("{} is installed already\n", *id);
    return done;
  }
  if (Status s = lifecycle.install(*bytes); !s) return s;
  id = installed_id(*bytes, lifecycle);
  if (!id) return id.error();
  if (id->empty()) return Error{"the peer does not list " + options.package + " after it"};
  fmt::print("installed {}\n", *id);
  return done;
}

/// Of a package that this peer has: another's approval would be committed, and nobody could run it.
Result<std::string> id_to_approve(const Options& options, Lifecycle& lifecycle) {
  if (!options.id.empty()) {
    const auto there = lifecycle.installed();
    if (!there) return there.error();
    if (std::ranges::find(*there, options.id, &Installed::package_id) == there->end())
      return Error{"this peer has not installed " + options.id + install_first};
    return options.id;
  }
  const auto bytes = read_file(options.package);
  if (!bytes) return bytes.error();
  auto id = installed_id(*bytes, lifecycle);
  if (id && id->empty()) return Error{"this peer has not installed " + options.package + install_first};
  return id;
}

/// The one asked for, else the one that counts if it has the version, else the next one.
Definition wanted(const Options& options, const std::optional<Committed>& now) {
  Definition out{options.version, static_cast<std::int64_t>(options.sequence)};
  if (out.sequence > 0) return out;
  out.sequence = !now                                         ? 1
                 : now->definition.version == options.version ? now->definition.sequence
                                                              : now->definition.sequence + 1;
  return out;
}

std::string described(const Definition& definition) {
  return fmt::format("version {} sequence {}", definition.version, definition.sequence);
}

Status approve(const Options& options, Lifecycle& lifecycle) {
  const auto id = id_to_approve(options, lifecycle);
  if (!id) return id.error();
  const auto now = lifecycle.committed();
  if (!now) return now.error();
  const auto definition = wanted(options, *now);
  const auto before = lifecycle.approved(definition);
  if (!before) return before.error();
  if (*before == *id) {
    fmt::print("{} is approved already\n", described(definition));
    return done;
  }
  if (Status s = lifecycle.approve(definition, *id); !s) return s;
  fmt::print("approved {} of {}\n", described(definition), *id);
  return done;
}

std::string approved_by(const std::map<std::string, bool>& approvals) {
  std::vector<std::string> approved, others;
  for (const auto& [msp_id, has] : approvals) (has ? approved : others).push_back(msp_id);
  const std::string by = approved.empty() ? "nobody" : fmt::format("{}", fmt::join(approved, ", "));
  return "approved by " + by + (others.empty() ? "" : fmt::format("; not by {}", fmt::join(others, ", ")));
}

Status commit(const Options& options, Lifecycle& lifecycle) {
  const auto now = lifecycle.committed();
  if (!now) return now.error();
  const auto definition = wanted(options, *now);
  if (*now && (*now)->definition == definition) {
    fmt::print("{} is committed already\n", described(definition));
    return done;
  }
  if (Status s = lifecycle.commit(definition); !s) {
    const auto approvals = lifecycle.approvals(definition);
    if (!approvals) return s;
    return Error{fmt::format("{}\n{} is {}", s.error().message, described(definition), approved_by(*approvals))};
  }
  fmt::print("committed {}\n", described(definition));
  return done;
}

nlohmann::json json_of(const fabric::ChannelConfig& channel) {
  nlohmann::json out{{"capabilities", channel.capabilities},
                     {"consensus", channel.consensus},
                     {"endorsement", channel.endorsement_words},
                     {"lifecycle_endorsement", channel.lifecycle_words}};
  for (const auto& organisation : channel.organisations) out["organisations"].push_back(organisation.msp_id);
  if (channel.batching) {
    out["batch_timeout_s"] = to_seconds(channel.batching->timeout_ns);
    out["batch_max_messages"] = channel.batching->max_messages;
  }
  return out;
}

/// `own_package`: that the organisation has approved, where that is known.
nlohmann::json service_json(Lifecycle& lifecycle, const std::string& own_package) {
  const Status answers = lifecycle.contract_answers();
  if (answers) return {{"answers", true}};
  const std::string& why = answers.error().message;
  const checks::Finding found = checks::assess_refusal(why);
  if (found.problem != checks::Problem::contract_silent) return {{"answers", true}, {"refusal", why}};
  std::string cure = found.cure.empty() ? checks::describe(*found.problem).cure : found.cure;
  if (why.find("did not answer within") != std::string::npos)
    cure = fmt::format("start `ledgerline-chaincode` with CHAINCODE_ID={}",
                       own_package.empty() ? "the package's id that is approved" : own_package);
  return {{"answers", false}, {"why", why}, {"cure", cure}};
}

std::string described(const Result<std::optional<std::string>>& own_package, const std::string& msp_id) {
  if (!own_package) return "not known: " + own_package.error().message;
  if (!*own_package) return fmt::format("none: {} has not approved this definition", msp_id);
  return fmt::format("{}, approved by {}", **own_package, msp_id);
}

void print_service(const nlohmann::json& service) {
  if (service["answers"].get<bool>())
    fmt::print("service     answers{}\n",
               service.contains("refusal") ? ": " + service["refusal"].get<std::string>() : "");
  else
    fmt::print("service     does not answer: {}\n            cure: {}\n", service["why"].get<std::string>(),
               service["cure"].get<std::string>());
}

/// False: the service does not answer.
Result<bool> status(const Options& options, Lifecycle& lifecycle) {
  const auto installed = lifecycle.installed();
  const auto committed = lifecycle.committed();
  const auto channel = lifecycle.channel();
  if (!committed) return committed.error();
  if (!channel) return channel.error();
  nlohmann::json out{{"channel", json_of(*channel)}};
  if (installed) {
    out["installed"] = nlohmann::json::array();
    for (const Installed& one : *installed) out["installed"].push_back(one.package_id);
  } else {
    out["installed_unknown"] = installed.error().message;  // an administrator's question
  }
  const auto definition = wanted(options, *committed);
  Result<std::optional<std::string>> own = std::optional<std::string>();
  const bool open = !*committed || (*committed)->definition.sequence < definition.sequence;
  if (*committed) {
    own = lifecycle.approved((*committed)->definition);
    const Fitness fitness = fitness_of(*channel, (*committed)->policy);
    out["committed"] = {{"version", (*committed)->definition.version},
                        {"sequence", (*committed)->definition.sequence},
                        {"approvals", (*committed)->approvals},
                        {"policy", fitness.policy},
                        {"direct_path", fitness.direct},
                        {"direct_path_why", fitness.direct_why}};
    if (own && *own) out["committed"]["own_package"] = **own;
    out["committed"]["service"] = service_json(lifecycle, own && *own ? **own : "");
  }
  if (open) {
    const auto approvals = lifecycle.approvals(definition);
    if (approvals)
      out["next"] = {{"version", definition.version}, {"sequence", definition.sequence}, {"approvals", *approvals}};
  }
  const bool answers = !*committed || out["committed"]["service"]["answers"].get<bool>();
  if (options.json) {
    fmt::print("{}\n", out.dump());
    return answers;
  }
  for (const auto& one : out.value("installed", nlohmann::json::array()))
    fmt::print("installed   {}\n", one.get<std::string>());
  if (!installed) fmt::print("installed   not known: {}\n", installed.error().message);
  if (*committed) {
    const auto& it = out["committed"];
    fmt::print("committed   {}, {}\n", described((*committed)->definition), approved_by((*committed)->approvals));
    if ((*committed)->definition.version != options.version)
      fmt::print("            this program's contract is version {}: approve and commit it\n", options.version);
    fmt::print("package     {}\n", described(own, lifecycle.msp_id()));
    print_service(it["service"]);
    fmt::print("endorsement {}\n", it["policy"].get<std::string>());
    fmt::print("direct path {}: {}\n", it["direct_path"].get<bool>() ? "yes" : "no",
               it["direct_path_why"].get<std::string>());
  } else {
    fmt::print("committed   nothing of that name\n");
  }
  if (out.contains("next")) {
    const std::map<std::string, bool> approvals = out["next"]["approvals"];
    fmt::print("next        {}, {}\n", described(definition), approved_by(approvals));
  }
  if (channel->batching)
    fmt::print("blocks      {:g} s behind their first transaction, or at {} transactions\n",
               to_seconds(channel->batching->timeout_ns), channel->batching->max_messages);
  return answers;
}

void print_commands(const Options& options, const std::string& verb, const fabric::ClientConfig& client) {
  const PeerCommands commands{client, client.identity_source.msp_dir};
  const Definition definition{options.version, static_cast<std::int64_t>(std::max<std::uint64_t>(1, options.sequence))};
  std::string text;
  if (verb == "install") {
    text = commands.install(options.package);
  } else if (verb == "approve") {
    text = commands.approve(definition, options.id, options.package);
  } else {
    text = verb == "commit" ? commands.commit(definition) : commands.status();
  }
  fmt::print("{}{}", commands.environment(), text);
}

Result<bool> run(const Options& options, const std::string& verb, fabric::ClientConfig client) {
  if (options.print) {
    print_commands(options, verb, client);
    return true;
  }
  auto lifecycle = Lifecycle::connect(std::move(client));
  if (!lifecycle) return lifecycle.error();
  if (verb == "status") return status(options, *lifecycle);
  const Status ended = verb == "install"   ? install(options, *lifecycle)
                       : verb == "approve" ? approve(options, *lifecycle)
                                           : commit(options, *lifecycle);
  if (!ended) return ended.error();
  return true;
}

std::vector<Verb> add_verbs(CommandLine& line, Options& options) {
  std::vector<Verb> verbs;
  Verb package = line.verb("package", "make the package of a contract's service; prints its id");
  package.option("--address", options.address, "HOST:PORT of ledgerline-chaincode, as the peers reach it").required();
  package.option("--tls-root", options.tls_root, "PEM file of the authority of the service's TLS certificate")
      .existing_file();
  package.flag("--client-auth", options.client_auth,
               "the service wants the peers' certificates, and their builder puts its own in");
  package.option("--client-certificate", options.client_certificate, "PEM file: with which the peers call")
      .existing_file();
  package.option("--client-key", options.client_key, "its key, which is then in the package").existing_file();
  package.option("--label", options.label, "the package's name").shows_default();
  package.option("--out", options.out, "the file").shows_default();
  verbs.push_back(package);
  verbs.push_back(line.verb("rules", "print who may do what: the page docs/access.md"));
  const auto add = [&](const char* name, const char* what) {
    Verb verb = line.verb(name, what);
    verb.option("--config", options.config, "TOML file with [ledger]").existing_file();
    verb.option("--endpoint", options.endpoint, "HOST:PORT of the organisation's peer");
    verb.option("--tls-ca", options.tls_ca, "PEM file of its TLS authorities").existing_file();
    verb.option("--server-name", options.server_name, "name in its certificate");
    verb.option("--tls-certificate", options.tls_certificate, "PEM file of the own TLS certificate, if it wants one")
        .existing_file();
    verb.option("--tls-key", options.tls_key, "its key").existing_file();
    verb.option("--msp-id", options.msp_id, "the organisation");
    verb.option("--msp-dir", options.msp_dir, "its administrator's msp folder").existing_path();
    verb.option("--channel", options.channel, "without --config").shows_default();
    verb.option("--name", options.name, "of the chaincode, without --config").shows_default();
    verb.flag("--print", options.print, "print the commands of Fabric's `peer` instead");
    verbs.push_back(verb);
    return verb;
  };
  const auto add_package = [&](Verb& verb) {
    verb.option("--package", options.package, "the package's file").existing_file();
  };
  const auto add_definition = [&](Verb& verb) {
    verb.option("--version", options.version, "of the definition").shows_default();
    verb.option("--sequence", options.sequence, "of the definition (default: as the channel has it, or the next)");
  };
  Verb installing = add("install", "install the package at a peer");
  add_package(installing);
  Verb approving = add("approve", "approve the definition with this package, for the organisation");
  add_package(approving);
  approving.option("--package-id", options.id, "LABEL:HASH in place of the file");
  add_definition(approving);
  Verb committing = add("commit", "commit the definition that organisations have approved");
  add_definition(committing);
  Verb showing = add("status", "what is installed, approved, committed; whether its service answers; its policy");
  showing.flag("--json", options.json, "as JSON");
  return verbs;
}

}  // namespace

int ledgerline::command::contract(int argc, char** argv) {
  CommandLine line("ledgerline contract", about, notes);
  Options options;
  const std::vector<Verb> verbs = add_verbs(line, options);
  if (const auto end = line.parse(argc, argv)) return *end;
  std::string name;
  for (const Verb& verb : verbs) {
    if (verb.is_given()) name = verb.name();
  }
  if (const std::string why = nonsense(options, name); !why.empty()) return fail(Error{why}, exit_usage);
  if (name == "package") return exit_code(make(options));
  if (name == "rules") return fmt::print("{}", access::access_page()), 0;
  auto client = client_of(options);
  return client ? exit_code(run(options, name, std::move(*client))) : fail(client.error(), exit_usage);
}
