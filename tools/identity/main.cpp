#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "chaincode/network/files/authority.hpp"
#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/config/config.hpp"
#include "common/crypto/crypto.hpp"
#include "common/process/children.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/rt/clock.hpp"
#include "tools/command/verbs.hpp"
#include "tools/identity/core/authority_commands.hpp"
#include "tools/identity/shell/identity_source.hpp"
#include "tools/init/core/host.hpp"

namespace {

using namespace ledgerline;
using crypto::IdentitySource;
using Pair = crypto::Renewal::Pair;

constexpr const char* about = "A host's key and certificate: from fabric-ca, renewed, revoked, and how long they hold.";
constexpr const char* notes = R"(
Examples:
  ledgerline identity enroll raven --ca https://ca.org1:7054 --ca-tls ca-tls.pem --secret-file raven.secret --subject O=org1 --msp-dir /etc/ledgerline/msp
  ledgerline identity renew --ca https://ca.org1:7054 --ca-tls ca-tls.pem --msp-dir /etc/ledgerline/msp
  ledgerline identity enroll raven --profile tls --hosts raven.local ... --certificate tls.pem --key tls.key
  ledgerline identity revoke raven --ca ... --msp-dir registrar/msp --list org1.crl
  ledgerline identity status --config /etc/ledgerline/agent.toml

Keys are made on this host, 0600, and stay on it. Agent and ground that run take what is renewed within seconds. Needs
fabric-ca-client (--program). docs/three-machines.md goes through it.
Exit codes: 0 done, of status: all hold for 30 days; 1 not; 2 wrong usage.)";

struct Options {
  std::string name, secret_file, program = "fabric-ca-client";
  identity::Authority authority;
  identity::Wanted wanted;
  IdentitySource source;
  std::string config, list, config_block, msp_id, update;
  identity::Revoked revoked;
  bool same_key = false, json = false;
};

std::int64_t unix_now_s() { return realtime_ns() / ns_per_s; }

Status run_command(const identity::Command& command, const identity::Home& home) {
  const auto ran = network::run_command(command, home.text() + "/log");
  return ran ? done : Status(ran.error());
}

Result<Pair> made_in(const identity::Home& home) {
  const auto files = crypto::identity_files(home.msp());
  if (!files) return files.error();
  auto pair = crypto::read_pair(*files);
  if (!pair) return pair.error();
  if (Status fits = crypto::check_fits(pair->key_pem, pair->certificate_pem); !fits)
    return Error{"the authority's answer: " + fits.error().message};
  return pair;
}

Status print(const Pair& pair) {
  print_line(fmt::format("{}, for {}", printable(pair.certificate.subject),
                         crypto::span_in_words(pair.certificate.not_after_s - unix_now_s())));
  return done;
}

Status enroll(Options& options) {
  if (!identity::is_free(options.source))
    return Error{fmt::format("{} has a key or a certificate already: `ledgerline identity renew`, or move it away",
                             identity::text_of(options.source))};
  const auto secret = options.secret_file.empty() ? ask_secret("Enrolment secret of " + options.name)
                                                  : read_secret(options.secret_file);
  if (!secret) return secret.error();
  const auto home = identity::Home::make(identity::text_of(options.source));
  if (!home) return home.error();
  const auto command = identity::enroll(options.authority, home->text(), options.name, *secret, options.wanted);
  if (!command) return command.error();
  if (Status ran = run_command(*command, *home); !ran) return ran;
  const auto pair = made_in(*home);
  if (!pair) return pair.error();
  if (Status placed = identity::put(options.source, *pair); !placed) return placed;
  return print(*pair);
}

/// Checked as the programs that take it will.
Status renew(Options& options) {
  const auto files = options.source.files_now();
  if (!files) return files.error();
  const auto old = crypto::read_pair(*files);
  if (!old) return old.error();
  if (options.wanted.subject_parts.empty()) {
    auto parts = identity::subject_parts(old->certificate.subject);
    if (!parts) return parts.error();
    options.wanted.subject_parts = std::move(*parts);
  }
  const auto home = identity::Home::make(identity::text_of(options.source));
  if (!home) return home.error();
  if (Status lent = home->put_pair(*old); !lent) return lent;
  const auto command =
      identity::renew(options.authority, home->text(), old->certificate.common_name, options.wanted, options.same_key);
  if (!command) return command.error();
  if (Status ran = run_command(*command, *home); !ran) return ran;
  const auto pair = made_in(*home);
  if (!pair) return pair.error();
  crypto::Renewal renewal(identity::text_of(options.source), old->certificate.subject, old->certificate.not_after_s);
  if (Status checked = renewal.check(pair, unix_now_s()); !checked)
    return Error{"the new certificate is not put in place: " + checked.error().message};
  if (Status placed = identity::put(options.source, *pair); !placed) return placed;
  return print(*pair);
}

Status revoke(Options& options) {
  const auto files = options.source.files_now();
  if (!files) return files.error();
  const auto registrar = crypto::read_pair(*files);
  if (!registrar) return registrar.error();
  const auto home = identity::Home::make(options.list);
  if (!home) return home.error();
  if (Status lent = home->put_pair(*registrar); !lent) return lent;
  options.revoked.name = options.name;
  const auto commands = identity::revoke(options.authority, home->text(), options.revoked);
  if (!commands) return commands.error();
  for (const identity::Command& command : *commands) {
    if (Status ran = run_command(command, *home); !ran) return ran;
  }
  const auto list = read_file(home->msp() + "/crls/crl.pem");
  if (!list) return list.error();
  if (Status written = replace_file(options.list, *list); !written) return written;
  print_line(options.list + ": what the authority has revoked");
  if (options.config_block.empty()) {
    print_line(
        "The authority gives no new certificate to who is revoked; the channel takes the old one until its "
        "configuration "
        "has the list: docs/three-machines.md says how.");
    return done;
  }
  const auto block = read_file(options.config_block);
  if (!block) return block.error();
  const auto update = network::revocation_update(*block, options.msp_id, *list);
  if (!update) return Error{options.config_block + ": " + update.error().message};
  if (Status written = replace_file(options.update, *update); !written) return written;
  print_line(fmt::format("{}: for an administrator of {}: peer channel update -f {} -c CHANNEL -o ORDERER --tls ...",
                         options.update, options.msp_id, options.update));
  return done;
}

struct Shown {
  std::string what, subject, issuer, problem;
  std::int64_t left_s = 0;
};

/// `config_dir`: where the host's authorities/ are; empty: beside the folder.
Shown inspect(const std::string& what, const IdentitySource& source, const std::string& config_dir) {
  const auto files = source.files_now();
  const auto pair = files ? crypto::read_pair(*files) : Result<Pair>(files.error());
  Shown shown{.what = what, .subject = {}, .issuer = {}, .problem = {}};
  if (!pair) {
    shown.problem = pair.error().message;
    return shown;
  }
  shown.subject = printable(pair->certificate.subject);
  shown.issuer = printable(pair->certificate.issuer);
  shown.left_s = pair->certificate.not_after_s - unix_now_s();
  Status good = crypto::check_fits(pair->key_pem, pair->certificate_pem);
  if (good && !source.msp_dir.empty()) {
    const std::filesystem::path folder = std::filesystem::absolute(source.msp_dir).lexically_normal();
    good = init::check_authority(config_dir.empty() ? folder.parent_path().string() : config_dir, folder.string(),
                                 pair->certificate_pem);
  }
  if (!good) shown.problem = good.error().message;
  return shown;
}

/// Of a program's config: [ledger]'s identity and [own_endorser]'s, and the TLS pair of each table that names one.
Result<std::vector<std::pair<std::string, IdentitySource>>> sources_of(const std::string& file) {
  auto config = Config::load(file);
  if (!config) return config.error();
  std::vector<std::pair<std::string, IdentitySource>> sources;
  sources.emplace_back("identity", IdentitySource{.msp_dir = config->text("ledger.msp_dir", ""),
                                                  .files = {config->text("ledger.certificate", ""),
                                                            config->text("ledger.private_key", "")}});
  if (const std::string own = config->text("own_endorser.msp_dir", ""); !own.empty())
    sources.emplace_back("[own_endorser]", IdentitySource{.msp_dir = own});
  const auto add_tls = [&](const std::string& table, const std::string& shown) {
    const crypto::IdentityFiles files{config->text(table + ".tls_certificate", ""),
                                      config->text(table + ".tls_key", "")};
    if (!files.certificate.empty()) sources.emplace_back("TLS of " + shown, IdentitySource{.files = files});
  };
  for (const std::string table : {"ledger", "service", "serve", "own_endorser"}) add_tls(table, "[" + table + "]");
  for (const std::string table : {"orderer", "endorser", "peer", "channel"}) {
    for (std::size_t i = 0; i < config->table_count(table); ++i)
      add_tls(fmt::format("{}.{}", table, i), fmt::format("[[{}]] {}", table, i + 1));
  }
  return sources;
}

Result<bool> status(const Options& options) {
  std::vector<std::pair<std::string, IdentitySource>> sources{{"identity", options.source}};
  if (!options.config.empty()) {
    auto found = sources_of(options.config);
    if (!found) return found.error();
    sources = std::move(*found);
  }
  bool good = true;
  nlohmann::json all = nlohmann::json::array();
  for (const auto& [what, source] : sources) {
    const std::string config_dir =
        options.config.empty() ? "" : std::filesystem::absolute(options.config).parent_path().string();
    const Shown one = inspect(what, source, config_dir);
    good = good && one.problem.empty() && one.left_s >= crypto::renew_within_days * crypto::day_s;
    if (options.json) {
      all.push_back({{"what", what},
                     {"place", identity::text_of(source)},
                     {"subject", one.subject},
                     {"issuer", one.issuer},
                     {"days", crypto::days_left(one.left_s, 0)},
                     {"problem", one.problem}});
    } else if (!one.problem.empty()) {
      print_line(fmt::format("{}: {}", what, one.problem));
    } else {
      print_line(fmt::format("{}: {}, of {}, {}", what, one.subject, one.issuer,
                             one.left_s < 0 ? "has ended" : crypto::span_in_words(one.left_s) + " left"));
    }
  }
  if (options.json) print_line(nlohmann::json{{"certificates", all}}.dump());
  return good;
}

void add_source(Verb& verb, Options& options, const char* what) {
  verb.option("--msp-dir", options.source.msp_dir, what);
  verb.option("--certificate", options.source.files.certificate, "PEM file, with --key, in place of --msp-dir");
  verb.option("--key", options.source.files.private_key, "PEM file of its key");
}

void add_authority(Verb& verb, Options& options) {
  verb.option("--ca", options.authority.url, "https://HOST:PORT of the authority's server").required();
  verb.option("--ca-tls", options.authority.tls_ca, "PEM file of the authority of its TLS certificate")
      .required()
      .existing_file();
  verb.option("--ca-name", options.authority.name, "where one server has several authorities");
  verb.option("--program", options.program, "fabric-ca-client, or where it is").shows_default();
}

void add_wanted(Verb& verb, Options& options, const char* subject) {
  verb.option("--subject", options.wanted.subject_parts, subject);
  verb.option("--hosts", options.wanted.hosts, "names and addresses in it, with commas; without: its name alone");
  verb.option("--profile", options.wanted.profile, "of the authority: tls, for a TLS certificate");
}

int run(Options& options, const std::string& verb) {
  const bool both = !options.source.files.certificate.empty() && !options.source.files.private_key.empty();
  const bool either = both || !options.source.files.certificate.empty() || !options.source.files.private_key.empty();
  const bool placed = options.source.msp_dir.empty() ? both : !either;
  if (verb == "status" ? placed == !options.config.empty() : !placed)
    return fail({verb == "status" ? "give one of --config, --msp-dir, and --certificate with --key"
                                  : "give one of --msp-dir, and --certificate with --key"},
                exit_usage);
  if (verb == "status") {
    const auto good = status(options);
    if (!good) return fail(good.error(), exit_usage);
    return *good ? 0 : 1;
  }
  const bool is_path = options.program.find('/') != std::string::npos;
  options.authority.program = is_path ? options.program : find_program(options.program);
  if (options.authority.program.empty() || ::access(options.authority.program.c_str(), X_OK) != 0)
    return fail({options.program + " is not there: it is fabric-ca's client; --program says where"}, exit_usage);
  options.authority.tls_ca = std::filesystem::absolute(options.authority.tls_ca).string();
  if (verb == "enroll") return exit_code(enroll(options));
  if (verb == "renew") return exit_code(renew(options));
  if (options.config_block.empty() != options.update.empty() || options.config_block.empty() != options.msp_id.empty())
    return fail({"--config-block, --msp-id and --update belong together"}, exit_usage);
  return exit_code(revoke(options));
}

}  // namespace

int ledgerline::command::identity(int argc, char** argv) {
  CommandLine line("ledgerline identity", about, notes);
  Options options;
  Verb enroll = line.verb("enroll", "make a key here, and have its certificate made");
  enroll.option("NAME", options.name, "who was registered at the authority").required();
  enroll.option("--secret-file", options.secret_file, "the secret of the registration, 0600; without: it is asked for")
      .existing_file();
  add_authority(enroll, options);
  add_wanted(enroll, options, "what stands beside the name: O=org1.example.com,C=DE");
  add_source(enroll, options, "where key and certificate are put");
  Verb renew = line.verb("renew", "a new certificate, with a new key, in place of one that still holds");
  renew.flag("--same-key", options.same_key, "for the key that is there");
  add_authority(renew, options);
  add_wanted(renew, options, "as it was enrolled with; without: as the certificate says");
  add_source(renew, options, "where they are");
  Verb revoke =
      line.verb("revoke", "at the authority: all certificates of a name, or one; and the list of all revoked");
  revoke.option("NAME", options.name, "whose");
  revoke.option("--serial", options.revoked.serial, "in place of NAME: of one certificate, hexadecimal, with --aki");
  revoke.option("--aki", options.revoked.authority_key, "its authority key identifier, hexadecimal");
  add_authority(revoke, options);
  add_source(revoke, options, "of the registrar, who may revoke");
  revoke.option("--list", options.list, "where the list is written, PEM").required();
  revoke.option("--config-block", options.config_block, "newest configuration block of the channel").existing_file();
  revoke.option("--msp-id", options.msp_id, "with it: whose list it is");
  revoke.option("--update", options.update,
                "with it: the update of the channel that an administrator has to sign and send");
  Verb status = line.verb("status", "whose certificates these are, and for how many days");
  status.option("--config", options.config, "of agent, ground or endorser: all that it names").existing_file();
  add_source(status, options, "where they are");
  status.flag("--json", options.json, "as JSON");
  if (const auto end = line.parse(argc, argv)) return *end;
  for (const Verb& verb : {enroll, renew, revoke, status}) {
    if (verb.is_given()) return run(options, verb.name());
  }
  return exit_usage;
}
