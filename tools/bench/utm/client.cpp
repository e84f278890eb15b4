// Registers a job's operational intents as Ledgerline does it: by its ledger client on the direct path, ends told by
// the block stream. Started by `ledgerline bench utm`.
#include <fmt/format.h>
#include <unistd.h>

#include <condition_variable>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/msg/contract.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/program/stop_signals.hpp"
#include "ledgerline.pb.h"
#include "tools/bench/utm/figures.hpp"
#include "tools/bench/utm/workload.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::utm;

constexpr TimeNs tick_ns = 100 * ns_per_ms;  // for signals
constexpr int mvcc_conflict = 11;

void say(const nlohmann::json& line) {
  fmt::print("{}\n", line.dump());
  std::fflush(stdout);
}

/// What the client's threads tell the main thread.
class Inbox {
 public:
  struct Ended {
    std::size_t intent;
    fabric::Outcome outcome;
    TimeNs at_ns;
  };
  void put(std::size_t intent, fabric::Outcome outcome) {
    const std::lock_guard lock(mutex_);
    ended_.push_back({intent, std::move(outcome), monotonic_ns()});
    news_.notify_one();
  }
  void connected(bool is) {
    const std::lock_guard lock(mutex_);
    connected_ = is;
    news_.notify_one();
  }
  bool connected() const {
    const std::lock_guard lock(mutex_);
    return connected_;
  }
  /// Waits for some, at most until `until_ns`.
  std::vector<Ended> take(TimeNs until_ns) {
    std::unique_lock lock(mutex_);
    const TimeNs wait_ns = std::clamp<TimeNs>(until_ns - monotonic_ns(), 0, tick_ns);
    news_.wait_for(lock, std::chrono::nanoseconds(wait_ns), [&] { return !ended_.empty(); });
    return std::exchange(ended_, {});
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable news_;
  std::vector<Ended> ended_;
  bool connected_ = false;
};

class Registrations {
 public:
  Registrations(Job job, std::unique_ptr<fabric::Client> client)
      : job_(std::move(job)), open_(job_.intents.size()), jitter_(job_.seed), client_(std::move(client)) {
    fabric::Client::StreamHandlers handlers;
    handlers.on_block = [](const fabric::Block&, std::string_view) {};
    handlers.on_connection = [this](bool connected, const std::string&) { inbox_.connected(connected); };
    blocks_ = client_->blocks(std::nullopt, std::move(handlers));
  }

  Status wait_for_blocks(TimeNs limit_ns) {
    const TimeNs until_ns = monotonic_ns() + limit_ns;
    while (!inbox_.connected() && !stop_requested) {
      if (monotonic_ns() > until_ns) return Error{"no block stream"};
      (void)inbox_.take(monotonic_ns() + tick_ns);
    }
    say({{"ready", true}, {"pid", ::getpid()}});
    return done;
  }

  void run() {
    start_ns_ = monotonic_ns();
    const TimeNs last_ns = job_.intents.empty() ? 0 : job_.intents.back().at_ns;
    const TimeNs until_ns = start_ns_ + last_ns + from_seconds(job_.drain_s);
    std::size_t next = 0, ended = 0;
    while (!stop_requested && ended < job_.intents.size() && monotonic_ns() < until_ns) {
      TimeNs due_ns = until_ns;
      if (next < job_.intents.size()) due_ns = std::min(due_ns, start_ns_ + job_.intents[next].at_ns);
      if (!retries_.empty()) due_ns = std::min(due_ns, retries_.begin()->first);
      for (Inbox::Ended& one : inbox_.take(due_ns)) ended += take(one) ? 1 : 0;
      const TimeNs now = monotonic_ns();
      for (; next < job_.intents.size() && now >= start_ns_ + job_.intents[next].at_ns; ++next) submit(next);
      while (!retries_.empty() && now >= retries_.begin()->first) {
        const std::size_t intent = retries_.begin()->second;
        retries_.erase(retries_.begin());
        submit(intent);
      }
    }
    for (std::size_t i = 0; i < job_.intents.size(); ++i) close(i, End::lost, monotonic_ns());
  }

  void tell() const {
    constexpr std::size_t per_line = 500;
    for (std::size_t i = 0; i < lines_.size(); i += per_line) {
      nlohmann::json some = nlohmann::json::array();
      for (std::size_t k = i; k < std::min(lines_.size(), i + per_line); ++k) some.push_back(lines_[k]);
      say({{"ended", some}});
    }
    say({{"result", {{"why", why_}}}});
  }

 private:
  struct Open {
    int attempts = 0, conflicts = 0;
    bool ended = false;
  };

  void submit(std::size_t i) {
    const Intent& intent = job_.intents[i];
    const crypto::Digest digest = crypto::sha256(intent.airspace);
    AnchorCall call;
    call.set_digest(std::string(digest.begin(), digest.end()));
    call.set_what(intent.what);
    ++open_[i].attempts;
    // Intents do not wait for one another.
    const fabric::EndorsementNeed need{.count = fabric::EndorsementNeed::Count::two, .in_order = false};
    client_->submit(
        {.function = contract::anchor, .args = {call.SerializeAsString()}, .told_by_block = true, .need = need},
        [this, i](fabric::Outcome outcome) { inbox_.put(i, std::move(outcome)); });
  }

  /// Whether the intent has ended by that.
  bool take(const Inbox::Ended& one) {
    using Kind = fabric::Outcome::Kind;
    Open& open = open_[one.intent];
    if (open.ended) return false;
    if (one.outcome.kind == Kind::committed) return close(one.intent, End::registered, one.at_ns);
    if (one.outcome.kind == Kind::refused && one.outcome.message.find(taken) != std::string::npos)
      return close(one.intent, End::refused, one.at_ns);
    why_ = one.outcome.message;
    if (one.outcome.kind != Kind::invalidated || one.outcome.code != mvcc_conflict)
      return close(one.intent, End::lost, one.at_ns);
    ++open.conflicts;
    if (open.attempts >= job_.retry.attempts) return close(one.intent, End::lost, one.at_ns);
    const double jitter = static_cast<double>(jitter_() >> 11) * 0x1.0p-53;
    retries_.emplace(one.at_ns + from_seconds(job_.retry.pause_ms(open.attempts, jitter) / 1e3), one.intent);
    return false;
  }

  bool close(std::size_t i, End end, TimeNs now) {
    Open& open = open_[i];
    if (open.ended) return false;
    open.ended = true;
    if (!job_.intents[i].measured) return true;
    const char* word = end == End::registered ? "registered" : end == End::refused ? "refused" : "lost";
    lines_.push_back({word, std::max(1, open.attempts), open.conflicts, to_seconds(job_.intents[i].at_ns) * 1e3,
                      to_seconds(now - start_ns_) * 1e3});
    return true;
  }

  static constexpr const char* taken = "has anchored this digest already";

  const Job job_;
  std::vector<Open> open_;
  std::multimap<TimeNs, std::size_t> retries_;  // when, which
  std::mt19937_64 jitter_;
  TimeNs start_ns_ = 0;
  std::vector<nlohmann::json> lines_;
  std::string why_;

  // In this order: the threads of the client and its stream use the inbox, and are ended first.
  Inbox inbox_;
  std::unique_ptr<fabric::Client> client_;
  std::unique_ptr<fabric::Client::Stream> blocks_;
};

Status run(const std::string& config_file, const std::string& job_file) {
  const auto text = read_file(job_file);
  if (!text) return text.error();
  auto job = read_job(*text);
  if (!job) return job.error();
  auto config = Config::load(config_file);
  if (!config) return config.error();
  auto ledger = fabric::ledger_config(*config);
  if (auto status = config->finish(); !status) return status;
  if (!ledger) return ledger.error();
  auto client = fabric::Client::create(std::move(ledger).value());
  if (!client) return client.error();
  Registrations registrations(std::move(job).value(), std::move(client).value());
  constexpr TimeNs start_limit_ns = 20 * ns_per_s;
  if (auto status = registrations.wait_for_blocks(start_limit_ns); !status) return status;
  registrations.run();
  registrations.tell();
  return done;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line("utm-client", "The client of `ledgerline bench utm`, which starts it", "");
  std::string config, job;
  line.option("--config", config, "TOML with [ledger], [[orderer]] and [[endorser]]").required();
  line.option("--job", job, "JSON").required();
  if (const auto end = line.parse(argc, argv)) return *end;
  catch_stop_signals();
  return exit_code(run(config, job));
}
