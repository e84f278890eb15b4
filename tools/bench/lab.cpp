#include "tools/bench/lab.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <ctime>
#include <optional>

#include "chaincode/identities/identities.hpp"
#include "common/base/file.hpp"
#include "common/process/usage.hpp"
#include "tools/configuration/config_file.hpp"

namespace ledgerline::bench {
namespace {

namespace fs = std::filesystem;
using configuration::toml;
using nlohmann::json;

constexpr TimeNs watch_ns = 50 * ns_per_ms;
constexpr TimeNs network_limit_ns = 120 * ns_per_s, client_limit_ns = 30 * ns_per_s;
constexpr TimeNs network_timeout_ns = 30 * ns_per_s, client_timeout_ns = 5 * ns_per_s;
constexpr double overtime_s = 10;
constexpr int log_lines = 8;
constexpr int names_of_b = 16;

std::string ledger_table(const Network::Access& access) {
  return fmt::format("[ledger]\nendpoint = {}\ntls_ca = {}\nmsp_id = {}\nmsp_dir = {}\n", toml(access.endpoint),
                     toml(access.tls_ca), toml(access.msp_id), toml(access.msp_dir));
}

std::string endorser_table(const std::string& msp_id, const std::string& endpoint, const std::string& tls_ca) {
  return fmt::format("\n[[endorser]]\nmsp_id = {}\nendpoint = {}\ntls_ca = {}\n", toml(msp_id), toml(endpoint),
                     toml(tls_ca));
}

std::string tail(const Children& children, const std::string& name, const fs::path& log) {
  const std::string lines = children.log_tail(name, log_lines);
  return lines.empty() ? " It logged nothing." : fmt::format(" The end of {}:\n{}", log.string(), lines);
}

/// CPU time of a process so far, to the nanosecond.
std::optional<double> cpu_seconds(pid_t process) {
  clockid_t clock{};
  timespec t{};
  if (::clock_getcpuclockid(process, &clock) != 0 || ::clock_gettime(clock, &t) != 0) return std::nullopt;
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Of a process and all that it has begun.
double cpu_seconds_of_tree(pid_t root) {
  double seconds = 0;
  for (const pid_t process : process_tree(root)) seconds += cpu_seconds(process).value_or(0);
  return seconds;
}

std::uint64_t count_in(const json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number_unsigned() ? found->get<std::uint64_t>() : 0;
}

}  // namespace

Network::Network(LabPaths paths, Settings settings, fs::path dir, const std::atomic<int>& interrupts)
    : paths_(std::move(paths)),
      settings_(settings),
      dir_(std::move(dir)),
      interrupts_(interrupts),
      name_(paths_.embedded ? "node" : "fabric"),
      children_([this](const std::string&, const std::string& line) { ready_ = line; }) {}

Network::~Network() {
  if (children_.is_running(name_)) children_.stop(name_, network_timeout_ns);
}

Status Network::wait_for_line(const std::string& name, TimeNs limit_ns) {
  const fs::path log = dir_ / (name + ".log");
  const TimeNs until_ns = monotonic_ns() + limit_ns;
  while (ready_.empty()) {
    if (interrupts_ > 0) return Error{"interrupted"};
    if (!children_.is_running(name)) {
      return Error{fmt::format("{} {}.{}", name, children_.how_it_ended(name), tail(children_, name, log))};
    }
    if (monotonic_ns() > until_ns) {
      return Error{
          fmt::format("{} was not ready within {:.0f} s.{}", name, to_seconds(limit_ns), tail(children_, name, log))};
    }
    children_.poll(watch_ns);
  }
  return done;
}

Network::Settings Network::settings_for(const Competitor& competitor) {
  if (competitor.published_settings) return {3, 10, 2000};
  return {.peers_in_background = competitor.endorser == Competitor::Endorser::within && competitor.blocks == "ordered"};
}

Status Network::up() {
  std::error_code error;
  fs::create_directories(dir_, error);
  std::vector<std::string> command{"--dir",           dir_ / "ledger",
                                   "--summary",       dir_ / "summary.json",
                                   "--batch-count",   std::to_string(settings_.batch_count),
                                   "--batch-timeout", std::to_string(settings_.batch_timeout_ms)};
  if (paths_.embedded) {
    command.insert(command.begin(), paths_.programs / "ledgerline-node");
    command.insert(command.end(), {"--listen", "127.0.0.1:0"});
  } else {
    command.insert(command.begin(), {paths_.programs / "ledgerline", "fabric", "run"});
    command.insert(command.end(), {"--tools", paths_.fabric, "--orderers", std::to_string(settings_.orderers)});
    for (int organisation = 1; settings_.peers_in_background && organisation <= 3; ++organisation)
      command.insert(command.end(), {"--background", fmt::format("org{}", organisation)});
    command.insert(command.end(), paths_.network_options.begin(), paths_.network_options.end());
  }
  if (auto s = children_.start({name_, command, dir_ / (name_ + ".log"), SIGTERM}); !s) return s;
  if (auto s = wait_for_line(name_, network_limit_ns); !s) return s;
  const json ready = json::parse(ready_, nullptr, false);
  const auto texts = [&](const char* key) {
    std::vector<std::string> list;
    if (!ready.is_object() || !ready.contains(key)) return list;
    for (const json& one : ready[key].is_array() ? ready[key] : json::array({ready[key]})) {
      if (one.is_string()) list.push_back(one.get<std::string>());
    }
    return list;
  };
  peers_ = texts(paths_.embedded ? "endpoint" : "peers");
  endorsers_ = texts("peers");
  orderers_ = texts(paths_.embedded ? "endpoint" : "orderers");
  if (peers_.empty() || orderers_.empty() || endorsers_.size() < 2)
    return Error{name_ + " did not say its endpoints: " + ready_};
  return enroll();
}

double Network::cpu_seconds() const { return cpu_seconds_of_tree(children_.pid(name_)); }

fs::path Network::endorser_dir(int organisation) const {
  return identities::organisation_dir(dir_ / "ledger", organisation) / "peers" /
         fmt::format("endorser0.{}", identities::domain_of(organisation));
}

std::string Network::endorser_config(int organisation, const fs::path& summary) const {
  const fs::path own = endorser_dir(organisation);
  Access as = access(organisation);
  as.msp_dir = own / "msp";
  return ledger_table(as) +
         fmt::format("config_block = {}\n\n[serve]\ntls_certificate = {}\ntls_key = {}\n\n[output]\nsummary = {}\n",
                     toml(as.config_block), toml((own / "tls/server.crt").string()),
                     toml((own / "tls/server.key").string()), toml(summary.string()));
}

Network::Access Network::access(int organisation, const std::string& user) const {
  const std::string ledger = dir_ / "ledger";
  const auto index = std::min<std::size_t>(organisation - 1u, peers_.size() - 1);
  const auto tls_ca_of = [](const fs::path& home, const std::string& domain) {
    return home / "tlsca" / fmt::format("tlsca.{}-cert.pem", domain);
  };
  const auto endorser = [&](int k) {
    return Access::Endorser{endorsers_[k - 1u],
                            tls_ca_of(identities::organisation_dir(ledger, k), identities::domain_of(k))};
  };
  const int host = static_cast<int>(index) + 1;  // whose peer it is; the embedded node is organisation 1's
  const fs::path peer_ca = tls_ca_of(identities::organisation_dir(ledger, host), identities::domain_of(host));
  return {.endpoint = peers_[index],
          .tls_ca = peer_ca,
          .msp_id = identities::msp_id_of(organisation),
          .msp_dir = identities::user_dir(ledger, organisation, user) / "msp",
          .orderer_tls_ca = paths_.embedded ? peer_ca : tls_ca_of(identities::ordering_dir(ledger), "ledgerline"),
          .config_block = ledger + "/teleop.block",
          .orderers = orderers_,
          .endorsers = {endorser(organisation), endorser(organisation == 1 ? 2 : 1)}};
}

// Side a speaks for tello1 ..., which every new ledger knows; side b's names are enrolled here.
Status Network::enroll() {
  const Access admin = access(2, "Admin");
  fs::path certificate;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(access(2).msp_dir + "/signcerts", error)) certificate = entry.path();
  if (auto s = write_file(dir_ / "admin.toml", ledger_table(admin)); !s) return s;
  std::vector<std::string> command{paths_.programs / "ledgerline",
                                   "control",
                                   "--config",
                                   dir_ / "admin.toml",
                                   "enroll",
                                   "--msp",
                                   admin.msp_id,
                                   "--cert",
                                   certificate};
  for (int k = 1; k <= names_of_b; ++k) command.push_back(fmt::format("ground{}", k));
  ready_.clear();
  if (auto s = children_.start({"control", command, dir_ / "control.log", SIGKILL}); !s) return s;
  return wait_for_line("control", client_limit_ns);
}

Result<json> Network::down() {
  if (!children_.is_running(name_)) {
    return Error{
        fmt::format("{} {}.{}", name_, children_.how_it_ended(name_), tail(children_, name_, dir_ / (name_ + ".log")))};
  }
  if (!children_.stop(name_, network_timeout_ns)) return Error{name_ + " did not end when asked to and was killed"};
  const auto text = read_file(dir_ / "summary.json");
  if (!text) return text.error();
  json summary = json::parse(*text, nullptr, false);
  if (!summary.is_object()) return Error{(dir_ / "summary.json").string() + " is no summary"};
  return summary;
}

namespace {

/// The two clients of a run, and what they have said so far.
class Pair {
 public:
  Pair(const LabPaths& paths, const Network& network, const Competitor& competitor, const Schedule& schedule,
       fs::path dir, const std::atomic<int>& interrupts)
      : paths_(paths),
        network_(network),
        competitor_(competitor),
        schedule_(schedule),
        dir_(std::move(dir)),
        interrupts_(interrupts),
        children_([this](const std::string& name, const std::string& line) { on_line(name, line); }) {}

  Result<Turn> run() {
    if (competitor_.endorser == Competitor::Endorser::beside) {
      for (const int organisation : {1, 2}) {
        if (auto s = start_endorser(organisation); !s) return s.error();
      }
    }
    for (const char* name : {"b", "a"}) {  // who asks comes last
      if (auto s = start(name); !s) return s.error();
    }
    const TimeNs until_ns = monotonic_ns() + from_seconds(schedule_.length_s() + overtime_s);
    while (children_.is_running("a") && children_.is_running("b") && monotonic_ns() < until_ns) {
      if (interrupts_ > 0) return Error{"interrupted"};
      children_.poll(watch_ns);
    }
    run_.timed_out = children_.is_running("a");
    for (const auto& [name, _] : endorsers_) {
      if (!children_.is_running(name))
        run_.why = fmt::format("{} {}.{}", name, children_.how_it_ended(name), tail(children_, name, log(name)));
    }
    for (const char* name : {"a", "b"}) {
      const bool died = !children_.is_running(name) && !children_.has_succeeded(name);
      if (died)
        run_.why = fmt::format("side {} {}.{}", name, children_.how_it_ended(name), tail(children_, name, log(name)));
      if (children_.is_running(name)) children_.stop(name, client_timeout_ns);
    }
    children_.poll(0);  // what they said last
    run_.competitor = competitor_.id;
    return run_;
  }

 private:
  struct Side {
    pid_t process = 0;
    double cpu_at_begin_s = 0;
  };

  static std::string endorser_name(int organisation) { return fmt::format("endorser{}", organisation); }

  Status start_endorser(int organisation) {
    std::error_code error;
    fs::create_directories(dir_, error);
    const std::string name = endorser_name(organisation);
    const fs::path config = dir_ / (name + ".toml");
    if (auto s = write_file(config, network_.endorser_config(organisation, dir_ / (name + ".json"))); !s) return s;
    endorsers_[name];
    const Children::Program program{name, {paths_.programs / "ledgerline-endorser", config}, log(name), SIGKILL};
    if (auto s = children_.start(program); !s) return s;
    return wait_for(name, [&] { return !endorsers_[name].empty(); });
  }

  /// Until it is there; an error says why it is not.
  Status wait_for(const std::string& name, const std::function<bool()>& there) {
    const TimeNs until_ns = monotonic_ns() + client_limit_ns;
    while (!there()) {
      if (interrupts_ > 0) return Error{"interrupted"};
      if (!children_.is_running(name) || monotonic_ns() > until_ns) {
        return Error{fmt::format("{}, {}: {}.{}", competitor_.title, name,
                                 children_.is_running(name) ? "not ready in time" : children_.how_it_ended(name),
                                 tail(children_, name, log(name)))};
      }
      children_.poll(watch_ns);
    }
    return done;
  }

  double ledger_cpu_seconds() const {
    double seconds = network_.cpu_seconds();
    for (const auto& [name, _] : endorsers_) seconds += cpu_seconds(children_.pid(name)).value_or(0);
    return seconds;
  }

  fs::path log(const std::string& name) const { return dir_ / (name + ".log"); }

  Status start(const std::string& name) {
    std::error_code error;
    fs::create_directories(dir_, error);
    const Network::Access access = network_.access(name == "a" ? 1 : 2);
    Children::Program program{name, {}, log(name), SIGKILL};
    if (competitor_.design == Design::ledgerline) {
      const fs::path config = dir_ / (name + ".toml");
      std::string text = ledger_table(access) +
                         fmt::format("signer = \"{}\"\nblocks = \"{}\"\n", competitor_.signer, competitor_.blocks);
      if (competitor_.validated) text += fmt::format("config_block = {}\n", toml(access.config_block));
      for (const std::string& orderer : access.orderers) {
        text += fmt::format("\n[[orderer]]\nendpoint = {}\ntls_ca = {}\n", toml(orderer), toml(access.orderer_tls_ca));
      }
      const auto& peer = access.endorsers.front();
      const auto own = endorsers_.find(endorser_name(name == "a" ? 1 : 2));
      if (own != endorsers_.end()) text += endorser_table(access.msp_id, own->second, peer.tls_ca);
      text += endorser_table(access.msp_id, peer.endpoint, peer.tls_ca);
      if (competitor_.endorser == Competitor::Endorser::within)
        text += fmt::format("\n[own_endorser]\nmsp_dir = {}\nsummary = {}\n",
                            toml((network_.endorser_dir(name == "a" ? 1 : 2) / "msp").string()),
                            toml((dir_ / (name + "-endorser.json")).string()));
      if (auto s = write_file(config, text); !s) return s;
      program.command = {paths_.programs / "two_way_client", "--role", name, "--config", config, "--schedule",
                         write_schedule(schedule_)};
    } else {
      const char* way = competitor_.design == Design::direct    ? "direct"
                        : competitor_.design == Design::polling ? "polling"
                                                                : "gateway";
      json endorsers = json::array();
      for (const auto& [endpoint, tls_ca] : access.endorsers)
        endorsers.push_back({{"endpoint", endpoint}, {"tlsCa", tls_ca}});
      const json ledger{{"way", way},
                        {"endpoint", access.endpoint},
                        {"tlsCa", access.tls_ca},
                        {"mspDir", access.msp_dir},
                        {"endorsers", endorsers},
                        {"orderer", access.orderers.front()},
                        {"ordererTlsCa", access.orderer_tls_ca},
                        {"pollMs", paths_.poll_ms}};
      program.command = {paths_.node, paths_.script, name, write_schedule(schedule_), ledger.dump()};
      program.environment = {"NODE_PATH=" + (paths_.npm / "node_modules").string()};
    }
    if (auto s = children_.start(program); !s) return s;
    return wait_for(name, [&] { return sides_[name].process != 0; });
  }

  void on_line(const std::string& name, const std::string& text) {
    const json line = json::parse(text, nullptr, false);
    if (!line.is_object()) return;
    if (line.contains("ready") && endorsers_.contains(name)) {
      endorsers_[name] = line.value("endpoint", "");
      return;
    }
    if (line.contains("ready")) sides_[name].process = static_cast<pid_t>(count_in(line, "pid"));
    if (line.contains("measuring")) {
      for (auto& [_, side] : sides_) side.cpu_at_begin_s = cpu_seconds(side.process).value_or(0);
      ledger_cpu_at_begin_s_ = ledger_cpu_seconds();
    }
    if (line.contains("measured")) {
      run_.answers = count_in(line, "answers");
      run_.ledger_cpu_s = ledger_cpu_seconds() - ledger_cpu_at_begin_s_;
      for (const auto& [_, side] : sides_) {
        // The CPU time of a process that is gone cannot be measured; the run says that it died.
        run_.cpu_s += cpu_seconds(side.process).value_or(side.cpu_at_begin_s) - side.cpu_at_begin_s;
      }
    }
    if (line.contains("progress") && name == "a") read_counts(line["progress"]);
    if (line.contains("latencies_us")) {
      for (const json& us : line["latencies_us"]) {
        if (us.is_number()) run_.times_ms.push_back(us.get<double>() / 1e3);
      }
    }
    if (line.contains("result") && line["result"].is_object()) {
      const json& result = line["result"];
      if (name == "a") read_counts(result);
      run_.transactions += count_in(result, "transactions");
      run_.blocks += count_in(result, "blocks");
      const json confirmed = result.value("ordered_blocks_confirmed_after_ms", json::object());
      run_.blocks_as_ordered += count_in(confirmed, "count");
      if (name == "a") run_.confirmed_after_ms = confirmed.value("median", 0.0);
      run_.failed += count_in(result, "failed");
      run_.dropped += count_in(result, "dropped");
      if (result.contains("why") && result["why"].is_string() && result["why"] != "") run_.why = result["why"];
    }
  }

  void read_counts(const json& counts) {
    run_.sent = count_in(counts, "sent");
    run_.answered = count_in(counts, "answered");
    run_.replaced = count_in(counts, "replaced");
  }

  const LabPaths& paths_;
  const Network& network_;
  const Competitor& competitor_;
  const Schedule& schedule_;
  fs::path dir_;
  const std::atomic<int>& interrupts_;
  Turn run_;
  std::map<std::string, Side> sides_;
  std::map<std::string, std::string> endorsers_;  ///< where each listens, by its name
  double ledger_cpu_at_begin_s_ = 0;
  Children children_;
};

}  // namespace

Result<Turn> exchange(const LabPaths& paths, const Network& network, const Competitor& competitor,
                      const Schedule& schedule, const fs::path& dir, const std::atomic<int>& interrupts) {
  return Pair(paths, network, competitor, schedule, dir, interrupts).run();
}

}  // namespace ledgerline::bench
