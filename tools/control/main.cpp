#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <variant>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/nearest_word.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/calls/repeat.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/rt/mailbox.hpp"
#include "common/verification/calls.hpp"
#include "common/verification/control_events.hpp"
#include "common/verification/control_records.hpp"
#include "ledgerline.pb.h"
#include "tools/command/verbs.hpp"
#include "tools/control/table.hpp"

namespace {

using namespace ledgerline;

struct Options {
  std::string config;
  std::string function;
  std::vector<std::string> drones;
  std::uint32_t priority = 0;
  bool fly = false, stop = false, cut = false;
  double within_s = 30;
  std::string msp, certificate, subject, role, file, digest, what, delegate;
  bool json = false, live = false;
};

Result<std::string> subject_of(const std::string& path) {
  const auto pem = read_file(path);
  if (!pem) return pem.error();
  const auto certificate = crypto::parse_certificate(*pem);
  if (!certificate) return Error{path + ": " + certificate.error().message};
  return certificate->subject;
}

/// Whether --msp and --cert name somebody who can exist. The contract takes any name of an organisation and any
/// subject.
Status check_named(const Options& options, const fabric::ClientConfig& ledger) {
  if (options.function != contract::enroll && options.function != contract::grant) return done;
  const auto msps = fabric::load_msps(options.config);
  if (!msps) return msps.error();
  std::vector<std::string> known;
  for (const crypto::MspRoot& msp : *msps) known.push_back(msp.msp_id);
  if (!known.empty() && options.msp != ledger.identity.name.msp_id && std::ranges::count(known, options.msp) == 0)
    return Error{fmt::format("{}: --msp {}: {} has no [[msp]] of that name{}", options.function, options.msp,
                             options.config, did_you_mean("; ", options.msp, known))};
  if (options.certificate.empty()) return done;
  const auto pem = read_file(options.certificate);
  if (!pem) return pem.error();
  const Status issued = fabric::check_certificate_of(options.msp, *pem, ledger, *msps);
  if (issued) return done;
  return Error{fmt::format("{}: {} {}", options.function, options.certificate, issued.error().message)};
}

/// The identity of a certificate file, or of nobody where no file is named.
Result<Identity> identity_of(const Options& options) {
  Identity identity;
  identity.set_msp_id(options.msp);
  if (options.certificate.empty()) return identity;
  auto subject = subject_of(options.certificate);
  if (!subject) return subject.error();
  identity.set_subject(std::move(*subject));
  return identity;
}

/// SHA-256 of a file of any size.
Result<std::string> digest_of(const std::string& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat status {};
  if (file < 0 || ::fstat(file, &status) != 0 || !S_ISREG(status.st_mode)) {
    if (file >= 0) ::close(file);
    return Error{path + ": is no file that can be read"};
  }
  const auto size = static_cast<std::size_t>(status.st_size);
  void* bytes = size == 0 ? nullptr : ::mmap(nullptr, size, PROT_READ, MAP_PRIVATE, file, 0);
  ::close(file);
  if (bytes == MAP_FAILED) return Error{path + ": cannot be mapped"};
  const crypto::Digest digest = crypto::sha256({static_cast<const char*>(bytes), size});
  if (bytes != nullptr) ::munmap(bytes, size);
  return std::string(digest.begin(), digest.end());
}

/// `own_msp_id`: the caller's.
Result<fabric::Call> make_call(const Options& options, const std::string& own_msp_id) {
  const auto call_with = [&](const auto& message) {
    return fabric::Call{options.function, {message.SerializeAsString()}};
  };
  const auto with_drones = [&](auto message) {
    for (const auto& drone : options.drones) message.add_drones(drone);
    return message;
  };
  const auto identity = identity_of(options);  // of those that are about one
  if (!identity) return identity.error();
  if (options.function == contract::enroll) {
    EnrollCall call = with_drones(EnrollCall());
    *call.mutable_identity() = *identity;
    if (options.role == "operator") call.set_role(OPERATOR);
    if (options.role == "supervisor") call.set_role(SUPERVISOR);
    if (options.role == "auditor") call.set_role(AUDITOR);
    return call_with(call);
  }
  if (options.function == contract::revoke) {
    RevokeCall call;
    *call.mutable_identity() = *identity;
    return call_with(call);
  }
  if (options.function == contract::grant) {
    GrantCall call = with_drones(GrantCall());
    Grant& grant = *call.mutable_grant();
    *grant.mutable_to() = *identity;
    grant.set_fly(options.fly);
    grant.set_max_priority(options.priority);
    grant.set_stop(options.stop);
    grant.set_cut(options.cut);
    return call_with(call);
  }
  if (options.function == contract::anchor || options.function == contract::verify) {
    const auto digest = options.digest.empty() ? digest_of(options.file) : *crypto::unhex(options.digest);
    if (!digest) return digest.error();
    AnchorCall call;
    call.set_digest(*digest);
    call.set_what(options.what);
    if (!identity->subject().empty()) {
      *call.add_signers() = *identity;
    } else {
      call.set_organisation(identity->msp_id());
    }
    return call_with(call);
  }
  if (options.function == contract::hand_over || options.function == contract::deny) {
    AnswerCall call = with_drones(AnswerCall());
    *call.mutable_to() = *identity;
    if (!options.subject.empty()) call.mutable_to()->set_subject(options.subject);
    return call_with(call);
  }
  if (options.function == contract::acquire || options.function == contract::release ||
      options.function == contract::request) {
    LeaseCall call = with_drones(LeaseCall());
    call.set_priority(options.priority);
    if (!options.delegate.empty()) {
      auto subject = subject_of(options.delegate);
      if (!subject) return subject.error();
      call.mutable_delegate()->set_msp_id(own_msp_id);
      call.mutable_delegate()->set_subject(std::move(*subject));
    }
    return call_with(call);
  }
  DronesCall call = with_drones(DronesCall());
  call.set_cut(options.cut);
  return call_with(call);
}

/// A stop goes on until it is on the ledger, whatever comes between. The others go on over what another wrote first,
/// and leave all else to who asked.
fabric::RepeatLimits limits_of(const Options& options) {
  if (options.function == contract::stop) return {.within_ns = static_cast<TimeNs>(options.within_s * 1e9)};
  return {.attempts = 10, .conflicts_only = true};
}

fabric::Outcome submit(fabric::Client& client, const Options& options, const fabric::Call& call) {
  fabric::Outcome outcome = verification::submit_claiming(
      client, call, options.drones, limits_of(options), [&](const fabric::Outcome& first) {
        spdlog::warn("{}: said again until it is on the ledger: {}", options.function, first.message);
      });
  if (outcome.block != 0 && !outcome.unheard.empty())
    spdlog::warn("{}: endorsed by less than all: {}", options.function, outcome.unheard);
  return outcome;
}

template <typename Message>
Status print_answer(const std::string& bytes) {
  Message answer;
  if (auto status = parse_message(bytes, answer); !status) return status;
  fmt::print("{}\n", to_json(answer));
  return done;
}

/// Page by page. Of each organisation its first, unless one is named: one that mints identities hides no other
/// organisation's.
Status print_anchors(fabric::Client& client, AnchorCall asked, const std::string& file) {
  constexpr int max_pages = 1'000;
  Anchors all;
  for (int page = 0; page < max_pages; ++page) {
    const auto answer = client.evaluate({contract::verify, {asked.SerializeAsString()}});
    if (!answer) return Error{fmt::format("{}: {}", contract::verify, answer.error().message)};
    Anchors some;
    if (auto status = parse_message(*answer, some); !status) return status;
    asked.set_bookmark(some.bookmark());
    some.clear_bookmark();
    all.MergeFrom(some);
    if (asked.bookmark().empty()) break;
  }
  if (all.anchors().empty()) return Error{file + ": nobody has anchored this"};
  return fmt::print("{}\n", to_json(all)), done;
}

constexpr const char* show = "show";

/// The control records of the drones that were named, or of all, in pages.
Result<std::vector<Control>> read_records(fabric::Client& client, const Options& options) {
  const verification::Evaluate evaluate = [&](const fabric::Call& call) { return client.evaluate(call); };
  if (!options.drones.empty()) return verification::read_controls(options.drones, evaluate);
  std::vector<Control> controls;
  const Status status = verification::read_all("control", evaluate, [&](const Asset& asset) {
    return parse_message(asset.msg_data(), controls.emplace_back());
  });
  if (!status) return status.error();
  return controls;
}

Status show_records(fabric::Client& client, const Options& options) {
  const auto controls = read_records(client, options);
  if (!controls) return Error{fmt::format("{}: {}", show, controls.error().message)};
  if (!options.json) return print_line(control::control_table(*controls)), done;
  Controls all;
  for (const Control& control : *controls) *all.add_controls() = control;
  return print_line(to_json(all)), done;
}

/// A line for each drone whose host is another than `host`, which is about to be its host.
std::string hosts_before(fabric::Client& client, const Options& options, const Identity& host) {
  std::string lines;
  for (const std::string& drone : options.drones) {
    const auto before =
        verification::read_control(drone, [&](const fabric::Call& call) { return client.evaluate(call); });
    // Left out where it cannot be read: whether the drone can be enrolled is for the ledger to say.
    if (!before || !before->has_owner()) continue;
    const Identity& owner = before->owner();
    if (owner.msp_id() == host.msp_id() && owner.subject() == host.subject()) continue;
    lines += fmt::format("{}: host was {} of {}\n", drone, owner.subject(), owner.msp_id());
  }
  return lines;
}

bool changes_records(const fabric::Block& block) {
  return std::ranges::any_of(
      block.transactions, [](const auto& tx) { return tx.code == 0 && verification::is_control_event(tx.event_name); });
}

/// Once, and again behind each block that changes a record, until asked to end.
Status show_live(fabric::Client& client, const Options& options) {
  std::atomic<bool> changed{true};
  Mailbox<std::monostate> wakeup;
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [&](const fabric::Block& block, std::string_view) {
    if (!changes_records(block)) return;
    changed = true;
    wakeup.wake();
  };
  handlers.on_connection = [&](bool connected, const std::string& why) {
    if (!connected) spdlog::warn("block stream: {}", why);
    changed = true;  // behind a break, too: what came meanwhile was not seen
    wakeup.wake();
  };
  const auto stream = client.blocks(std::nullopt, std::move(handlers));
  while (!stop_requested) {
    if (!changed.exchange(false)) {
      wakeup.wait(200 * ns_per_ms);  // and see whether to end
      wakeup.pop_all();
      continue;
    }
    if (auto status = show_records(client, options); !status) return status;
  }
  return done;
}

Status call_contract(const Options& options, fabric::ClientConfig ledger) {
  if (auto status = check_named(options, ledger); !status) return status;
  const std::string own_msp_id = ledger.identity.name.msp_id;
  auto client = fabric::Client::create(verification::for_contract(std::move(ledger)));
  if (!client) return client.error();
  if (options.function == show) return options.live ? show_live(**client, options) : show_records(**client, options);
  auto call = make_call(options, own_msp_id);
  if (!call) return call.error();
  if (options.function == contract::verify) {
    AnchorCall asked;
    if (auto status = parse_message(call->args[0], asked); !status) return status;
    return print_anchors(**client, std::move(asked), options.file + options.digest);
  }
  std::string before;
  if (options.function == contract::enroll && !options.drones.empty()) {
    const auto host = identity_of(options);
    if (!host) return host.error();
    before = hosts_before(**client, options, *host);
  }
  const fabric::Outcome outcome = submit(**client, options, *call);
  if (outcome.kind != fabric::Outcome::Kind::committed)
    return Error{fmt::format("{}: {}", options.function, outcome.message)};
  if (options.function == contract::anchor) return fmt::print("{}\n", outcome.tx_id), done;
  fmt::print(stderr, "{}transaction {}\n", before, outcome.tx_id);  // beside the JSON
  if (options.function == contract::unclaim) return done;
  return options.function == contract::stop ? print_answer<Stops>(outcome.answer)
                                            : print_answer<Controls>(outcome.answer);
}

constexpr const char* about =
    "Who may fly what: changes the control records of drones on the ledger, as the identity in the config.\n"
    "Prints the records as they now are (of stop: the stops), as JSON; the transaction's id: to standard error.";
constexpr const char* notes = R"(Examples:
  ledgerline control --config operator.toml acquire tello1 tello2
  ledgerline control --config operator.toml acquire --delegate-cert station.pem tello1   # which then flies it for you
  ledgerline control --config operator.toml stop tello1
  ledgerline control --config admin.toml enroll --msp Org1MSP --cert host.pem tello1
  ledgerline control --config admin.toml enroll --msp Org2MSP --cert pilot.pem --role operator
  ledgerline control --config admin.toml revoke --msp Org2MSP --cert pilot.pem
  ledgerline control --config admin.toml grant --msp Org2MSP --fly --max-priority 10 tello1
  ledgerline control --config admin.toml grant --msp Org2MSP tello1      # of nothing: takes it back, and the lease
  ledgerline control --config pilot.toml request --priority 3 tello1
  ledgerline control --config operator.toml hand_over --msp Org2MSP --cert pilot.pem tello1
  ledgerline control --config supervisor.toml evict tello1
  ledgerline control --config operator.toml show
  ledgerline control --config operator.toml anchor --what "flight 7, camera 2" flight7.mp4
Exit codes: 0 done, 1 refused or not reached, 2 bad usage.)";

/// Empty: it is one.
std::string digest_problem(const std::string& text) {
  const auto bytes = crypto::unhex(text);
  return bytes && bytes->size() == sizeof(crypto::Digest) ? "" : text + " is no SHA-256";
}

std::vector<Verb> add_verbs(CommandLine& line, Options& options) {
  std::vector<Verb> verbs;
  const auto add = [&](const std::string& name, const std::string& help) {
    Verb verb = line.verb(name, help);
    verb.option("drones", options.drones, "names of drones").required(name != contract::enroll && name != show);
    verbs.push_back(verb);
    return verb;
  };
  Verb enroll =
      add(contract::enroll, "bind drones to the identity of their host, or give an identity a role (administrators)");
  enroll.option("--role", options.role, "what else it may do; an auditor commands nothing, whatever it is granted")
      .one_of({"operator", "supervisor", "auditor"});
  enroll.option("--msp", options.msp, "MSP id of the host").required();
  enroll.option("--cert", options.certificate, "certificate of the host, PEM, by an authority of that organisation")
      .required()
      .existing_file();
  Verb revoke = line.verb(
      contract::revoke, "take an identity's role back: from that block on nobody flies what it says (administrators)");
  revoke.option("--msp", options.msp, "MSP id of the identity").required();
  revoke.option("--cert", options.certificate, "its certificate, PEM").required().existing_file();
  verbs.push_back(revoke);
  Verb grant = add(
      contract::grant,
      "what another organisation, or one identity there, may do with drones (administrators): replaces what it had");
  grant.option("--msp", options.msp, "MSP id of the other organisation").required();
  grant
      .option("--cert", options.certificate,
              "certificate of the one identity, PEM; without: its operators and supervisors")
      .existing_file();
  grant.flag("--fly", options.fly, "acquire them, and stop them");
  grant.option("--max-priority", options.priority, "the highest priority of its leases").shows_default();
  grant.flag("--stop", options.stop, "land them");
  grant.flag("--cut", options.cut, "motors off, and land them");
  const auto add_delegate = [&](Verb& verb) {
    verb.option("--delegate-cert", options.delegate,
                "certificate, PEM, of who commands in your place, of your organisation; without: you do")
        .existing_file();
  };
  Verb acquire = add(contract::acquire, "take the lease");
  acquire.option("--priority", options.priority, "a higher one pre-empts");
  add_delegate(acquire);
  add(contract::release, "give the lease back");
  Verb request = add(contract::request, "ask the holder for the lease");
  request.option("--priority", options.priority, "of the lease that is asked for");
  add_delegate(request);
  for (const auto& [function, help] : {std::pair(contract::hand_over, "give the lease to one who has requested it"),
                                       std::pair(contract::deny, "end somebody's request, or one's own")}) {
    Verb answer = add(function, help);
    answer.option("--msp", options.msp, "MSP id of who has requested it").required();
    answer.option("--subject", options.subject, "its subject, as `show` prints it");
    answer.option("--cert", options.certificate, "or its certificate, PEM").existing_file();
  }
  add(contract::evict, "take the lease from its holder (a supervisor of the drone's organisation, or its host)");
  Verb stop = add(contract::stop, "land at once, no matter who flies");
  stop.flag("--cut", options.cut, "motors off instead of landing");
  stop.option("--within", options.within_s, "seconds for which it is said again until it is on the ledger")
      .within(0.0, 3600.0)
      .shows_default();
  add(contract::clear_stop, "clear one's own stop, or all as a supervisor of the drone's organisation");
  line.renamed("resume", contract::clear_stop);
  add(contract::unclaim, "end claims of drones that were left behind");
  Verb anchor = line.verb(contract::anchor, "put a file's hash on the ledger; prints the transaction's id");
  anchor.option("file", options.file, "the file").required().existing_file();
  anchor.option("--what", options.what, "what it is, in a few words");
  verbs.push_back(anchor);
  Verb verify = line.verb(contract::verify, "print who has anchored this very file, and when; exit code 1: nobody");
  Option file = verify.option("file", options.file, "the file").existing_file();
  verify.option("--digest", options.digest, "its SHA-256 instead, as `ledgerline missions digest` prints an approval's")
      .checked_by("HEX", digest_problem)
      .excludes(file);
  verify.option("--msp", options.msp, "MSP id: all of that organisation; without: the first 16 of each");
  verify.option("--cert", options.certificate, "certificate of the one signer that is asked for, PEM; with --msp")
      .existing_file();
  verbs.push_back(verify);
  Verb showing = add(
      show, "print whose drones they are, who holds them, who stopped them, to whom they are granted; no name: of all");
  showing.flag("--json", options.json, "the records as JSON, in one line with --live");
  showing.flag("--live", options.live, "again whenever one changes, until Ctrl-C");
  return verbs;
}

}  // namespace

int ledgerline::command::control(int argc, char** argv) {
  CommandLine line("ledgerline control", about, notes);
  Options options;
  line.option("--config", options.config, "TOML file with [ledger]").required();
  const std::vector<Verb> verbs = add_verbs(line, options);
  if (const auto end = line.parse(argc, argv)) return *end;
  if (options.live) catch_stop_signals();
  for (const Verb& verb : verbs) {
    if (verb.is_given()) options.function = verb.name();
  }
  if (options.function == contract::verify && options.file.empty() && options.digest.empty())
    return fail(Error{"verify: name a file, or --digest"}, exit_usage);
  auto ledger = fabric::load_ledger_config(options.config);
  return ledger ? exit_code(call_contract(options, std::move(*ledger))) : fail(ledger.error(), exit_usage);
}
