#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "chaincode/lifecycle/lifecycle.hpp"
#include "chaincode/lifecycle/package.hpp"
#include "chaincode/lifecycle/printed.hpp"
#include "common/base/file.hpp"
#include "common/config/config.hpp"
#include "common/fabric/config.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"

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
Exit codes: 0 done, or done already; 1 failed; 2 wrong usage.)";

struct Wish {
  std::string config, endpoint, tls_ca, server_name, tls_certificate, tls_key, msp_id, msp_dir;
  std::string channel = "teleop", name = "ledgerline";
  std::string version = contract_version();
  std::uint64_t sequence = 0;
  std::string package, id;
  std::string label = "ledgerline_1", address, tls_root, client_certificate, client_key, out = "ledgerline.tgz";
  bool client_auth = false, print = false, json = false;
};

/// The options that stand in place of a file, as one.
std::string config_text(const Wish& wish) {
  std::string text = "[ledger]\n";
  const auto line = [&](const char* key, const std::string& value) {
    if (!value.empty()) text += fmt::format("{} = {}\n", key, nlohmann::json(value).dump());
  };
  line("endpoint", wish.endpoint);
  line("tls_ca", wish.tls_ca);
  line("server_name", wish.server_name);
  line("tls_certificate", wish.tls_certificate);
  line("tls_key", wish.tls_key);
  line("msp_id", wish.msp_id);
  line("msp_dir", wish.msp_dir);
  line("channel", wish.channel);
  line("contract", wish.name);
  return text;
}

struct Access {
  fabric::ClientConfig client;
  std::string msp_dir;
};

Result<Access> access_of(const Wish& wish) {
  auto config = wish.config.empty() ? Config::parse(config_text(wish), "options") : Config::load(wish.config);
  if (!config) return config.error();
  auto client = fabric::ledger_config(*config);
  const std::string msp_dir = config->text("ledger.msp_dir", "");
  config->left_to_another("msp");  // a drone's or a ground's own file will do
  if (Status s = config->finish(); !s) return s.error();
  if (!client) return client.error();
  return Access{std::move(*client), msp_dir};
}

/// Of the file's bytes, with the label that its maker gave it.
Result<std::string> id_of(const Wish& wish) {
  if (!wish.id.empty()) return wish.id;
  if (wish.package.empty()) return Error{"which package? give --package FILE, or --package-id LABEL:HASH"};
  const auto bytes = read_file(wish.package);
  if (!bytes) return bytes.error();
  return package_id(wish.label, *bytes);
}

Status make(const Wish& wish) {
  if (!is_label(wish.label)) return Error{"--label: letters and digits, inside also _ . + -"};
  if (wish.client_certificate.empty() != wish.client_key.empty())
    return Error{"--client-certificate and --client-key belong together"};
  ServicePlace place{.address = wish.address, .client_auth = wish.client_auth || !wish.client_key.empty()};
  const auto take = [](const std::string& path, std::string& into) -> Status {
    if (path.empty()) return done;
    auto text = read_file(path);
    if (!text) return text.error();
    into = std::move(*text);
    return done;
  };
  Status read = take(wish.tls_root, place.root_pem);
  if (read) read = take(wish.client_certificate, place.client_pem);
  if (!read) return read;
  if (!wish.client_key.empty()) {
    auto key = crypto::read_key_file(wish.client_key);
    if (!key) return key.error();
    place.client_key_pem = std::move(*key);
  }
  const std::string package = make_package(wish.label, connection_json(place));
  if (Status s = write_file(wish.out, package, place.client_key_pem.empty() ? 0644 : 0600); !s) return s;
  fmt::print("{}\n", package_id(wish.label, package));
  if (place.root_pem.empty())
    fmt::print(stderr,
               "without --tls-root peers call the service in the clear: whoever is between them can answer for it\n");
  if (!place.client_key_pem.empty())
    fmt::print(stderr, "the package holds the key of {}: whoever may fetch it from a peer has it\n", wish.client_key);
  return done;
}

Status install(const Wish& wish, Lifecycle& lifecycle) {
  const auto id = id_of(wish);
  const auto bytes = read_file(wish.package);
  if (!id || !bytes) return id ? bytes.error() : id.error();
  const auto there = lifecycle.installed();
  if (!there) return there.error();
  if (std::any_of(there->begin(), there->end(), [&](const Installed& one) { return one.package_id == *id; })) {
    fmt::print("{} is installed already\n", *id);
    return done;
  }
  if (Status s = lifecycle.install(*bytes); !s) return s;
  const auto now = lifecycle.installed();
  if (!now) return now.error();
  if (std::none_of(now->begin(), now->end(), [&](const Installed& one) { return one.package_id == *id; }))
    return Error{"the peer does not list " + *id + " after it: was the package made with another --label?"};
  fmt::print("installed {}\n", *id);
  return done;
}

/// The one asked for, else the one that counts if it has the version, else the next one.
Definition wanted(const Wish& wish, const std::optional<Committed>& now) {
  Definition out{wish.version, static_cast<std::int64_t>(wish.sequence)};
  if (out.sequence > 0) return out;
  out.sequence = !now                                      ? 1
                 : now->definition.version == wish.version ? now->definition.sequence
                                                           : now->definition.sequence + 1;
  return out;
}

std::string described(const Definition& definition) {
  return fmt::format("version {} sequence {}", definition.version, definition.sequence);
}

Status approve(const Wish& wish, Lifecycle& lifecycle) {
  const auto id = id_of(wish);
  if (!id) return id.error();
  const auto now = lifecycle.committed();
  if (!now) return now.error();
  const auto definition = wanted(wish, *now);
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

std::string approvers(const std::map<std::string, bool>& approvals, bool approved) {
  std::vector<std::string> names;
  for (const auto& [msp_id, has] : approvals) {
    if (has == approved) names.push_back(msp_id);
  }
  return names.empty() ? "nobody" : fmt::format("{}", fmt::join(names, ", "));
}

Status commit(const Wish& wish, Lifecycle& lifecycle) {
  const auto now = lifecycle.committed();
  if (!now) return now.error();
  const auto definition = wanted(wish, *now);
  if (*now && (*now)->definition == definition) {
    fmt::print("{} is committed already\n", described(definition));
    return done;
  }
  if (Status s = lifecycle.commit(definition); !s) {
    const auto approvals = lifecycle.approvals(definition);
    if (!approvals) return s;
    return Error{fmt::format("{}\n{} is approved by {}; not by {}", s.error().what, described(definition),
                             approvers(*approvals, true), approvers(*approvals, false))};
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

Status status(const Wish& wish, Lifecycle& lifecycle) {
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
    out["installed_unknown"] = installed.error().what;  // an administrator's question
  }
  const auto definition = wanted(wish, *committed);
  const bool open = !*committed || (*committed)->definition.sequence < definition.sequence;
  if (*committed) {
    const Fitness fitness = fitness_of(*channel, (*committed)->policy);
    out["committed"] = {{"version", (*committed)->definition.version},
                        {"sequence", (*committed)->definition.sequence},
                        {"approvals", (*committed)->approvals},
                        {"policy", fitness.policy},
                        {"direct_path", fitness.direct},
                        {"direct_path_why", fitness.direct_why}};
    if (const auto own = lifecycle.approved((*committed)->definition); own && *own)
      out["committed"]["own_package"] = **own;
  }
  if (open) {
    const auto approvals = lifecycle.approvals(definition);
    if (approvals)
      out["next"] = {{"version", definition.version}, {"sequence", definition.sequence}, {"approvals", *approvals}};
  }
  if (wish.json) {
    fmt::print("{}\n", out.dump());
    return done;
  }
  for (const auto& one : out.value("installed", nlohmann::json::array()))
    fmt::print("installed   {}\n", one.get<std::string>());
  if (!installed) fmt::print("installed   not known: {}\n", installed.error().what);
  if (*committed) {
    const auto& it = out["committed"];
    fmt::print("committed   {}, approved by {}; not by {}\n", described((*committed)->definition),
               approvers((*committed)->approvals, true), approvers((*committed)->approvals, false));
    if ((*committed)->definition.version != wish.version)
      fmt::print("            this program's contract is version {}: approve and commit it\n", wish.version);
    fmt::print("endorsement {}\n", it["policy"].get<std::string>());
    fmt::print("direct path {}: {}\n", it["direct_path"].get<bool>() ? "yes" : "no",
               it["direct_path_why"].get<std::string>());
  } else {
    fmt::print("committed   nothing of that name\n");
  }
  if (out.contains("next")) {
    const std::map<std::string, bool> approvals = out["next"]["approvals"];
    fmt::print("next        {}, approved by {}; not by {}\n", described(definition), approvers(approvals, true),
               approvers(approvals, false));
  }
  if (channel->batching)
    fmt::print("blocks      {:g} s behind their first transaction, or at {} transactions\n",
               to_seconds(channel->batching->timeout_ns), channel->batching->max_messages);
  return done;
}

Status print_commands(const Wish& wish, const std::string& verb, const Access& access) {
  const PeerCommands commands{access.client, access.msp_dir};
  const Definition definition{wish.version, static_cast<std::int64_t>(std::max<std::uint64_t>(1, wish.sequence))};
  std::string text;
  if (verb == "install") {
    if (wish.package.empty()) return Error{"which package? give --package FILE"};
    text = commands.install(wish.package);
  } else if (verb == "approve") {
    const auto id = id_of(wish);
    if (!id) return id.error();
    text = commands.approve(definition, *id);
  } else {
    text = verb == "commit" ? commands.commit(definition) : commands.status();
  }
  fmt::print("{}{}", commands.environment(), text);
  return done;
}

Status run(const Wish& wish, const std::string& verb) {
  if (verb == "package") return make(wish);
  auto access = access_of(wish);
  if (!access) return access.error();
  if (wish.print) return print_commands(wish, verb, *access);
  auto lifecycle = Lifecycle::connect(std::move(access->client));
  if (!lifecycle) return lifecycle.error();
  if (verb == "install") return install(wish, *lifecycle);
  if (verb == "approve") return approve(wish, *lifecycle);
  return verb == "commit" ? commit(wish, *lifecycle) : status(wish, *lifecycle);
}

std::vector<Verb> add_verbs(CommandLine& line, Wish& wish) {
  std::vector<Verb> verbs;
  Verb package = line.verb("package", "make the package of a contract's service; prints its id");
  package.option("--address", wish.address, "HOST:PORT of ledgerline-chaincode, as the peers reach it").required();
  package.option("--tls-root", wish.tls_root, "PEM file of the authority of the service's TLS certificate")
      .existing_file();
  package.flag("--client-auth", wish.client_auth,
               "the service wants the peers' certificates, and their builder puts its own in");
  package.option("--client-certificate", wish.client_certificate, "PEM file: with which the peers call")
      .existing_file();
  package.option("--client-key", wish.client_key, "its key, which is then in the package").existing_file();
  package.option("--label", wish.label, "the package's name").shows_default();
  package.option("--out", wish.out, "the file").shows_default();
  verbs.push_back(package);
  const auto add = [&](const char* name, const char* what) {
    Verb verb = line.verb(name, what);
    verb.option("--config", wish.config, "TOML file with [ledger]").existing_file();
    verb.option("--endpoint", wish.endpoint, "HOST:PORT of the organisation's peer");
    verb.option("--tls-ca", wish.tls_ca, "PEM file of its TLS authorities");
    verb.option("--server-name", wish.server_name, "name in its certificate");
    verb.option("--tls-certificate", wish.tls_certificate, "PEM file of the own TLS certificate, if it wants one");
    verb.option("--tls-key", wish.tls_key, "its key");
    verb.option("--msp-id", wish.msp_id, "the organisation");
    verb.option("--msp-dir", wish.msp_dir, "its administrator's msp folder");
    verb.option("--channel", wish.channel, "without --config").shows_default();
    verb.option("--name", wish.name, "of the chaincode, without --config").shows_default();
    verb.flag("--print", wish.print, "print the commands of Fabric's `peer` instead");
    verbs.push_back(verb);
    return verb;
  };
  const auto add_package = [&](Verb& verb) {
    verb.option("--package", wish.package, "the package's file").existing_file();
    verb.option("--label", wish.label, "that it was made with").shows_default();
  };
  const auto add_definition = [&](Verb& verb) {
    verb.option("--version", wish.version, "of the definition").shows_default();
    verb.option("--sequence", wish.sequence, "of the definition (default: as the channel has it, or the next)");
  };
  Verb installing = add("install", "install the package at a peer");
  add_package(installing);
  Verb approving = add("approve", "approve the definition with this package, for the organisation");
  add_package(approving);
  approving.option("--package-id", wish.id, "LABEL:HASH in place of the file");
  add_definition(approving);
  Verb committing = add("commit", "commit the definition that organisations have approved");
  add_definition(committing);
  Verb showing = add("status", "what is installed, approved, committed; its policy, and what that means");
  showing.flag("--json", wish.json, "as JSON");
  return verbs;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line("contract", about, notes);
  Wish wish;
  const std::vector<Verb> verbs = add_verbs(line, wish);
  if (const auto end = line.parse(argc, argv)) return *end;
  for (const Verb& verb : verbs) {
    if (verb.given()) return exit_code(run(wish, verb.name()));
  }
  return exit_usage;
}
