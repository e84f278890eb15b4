#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <condition_variable>
#include <cstdio>
#include <iostream>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/rt/clock.hpp"

/// A client that keeps on writing numbered transactions while a test kills parts of the ledger, and says at the end
/// whether the chain has what was acknowledged. Commands on standard input, one a line; each is answered by a line of
/// JSON:
///
///     mark     begins to watch: a fault follows
///     watch    what was seen since the mark: the maximum times without a commit and without a block, ...
///     end      ends the load, reads the whole chain from every peer, and checks
namespace {

using namespace ledgerline;
using nlohmann::json;

constexpr const char* asset = "tello1/fault";

/// A state, which needs one endorsement; its type is its number.
std::string frame(std::uint64_t number) {
  return json{{"assets", {{{"id", asset}, {"msgType", std::to_string(number)}}}}, {"stream", true}}.dump();
}
constexpr std::size_t max_in_flight = 16;

/// The maximum time between two events, including the interval that has not ended yet.
class Gap {
 public:
  void happened(TimeNs now) {
    max_ = std::max(max_, now - last_);
    last_ = now;
  }
  void reset(TimeNs now) {
    max_ = 0;
    last_ = now;
  }
  double ms(TimeNs now) const { return to_ms(std::max(max_, now - last_)); }

 private:
  TimeNs max_ = 0, last_ = 0;
};

class Load {
 public:
  Load(fabric::Client& client, double rate_hz) : client_(client), period_(from_seconds(1 / rate_hz)) {
    fabric::Client::StreamHandlers handlers;
    handlers.on_block = [this](const fabric::Block&, std::string_view) {
      const std::lock_guard lock(mutex_);
      blocks_.happened(monotonic_ns());
    };
    handlers.on_connection = [this](bool connected, const std::string&) {
      const std::lock_guard lock(mutex_);
      if (!connected) ++stream_breaks_;
    };
    stream_ = client_.blocks(std::nullopt, std::move(handlers));
    thread_ = std::thread([this] { run(); });
  }
  ~Load() { end(); }

  /// Returns when nothing is in flight any more.
  void end() {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    if (thread_.joinable()) thread_.join();
    stream_.reset();
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return in_flight_ == 0; });
  }
  void mark() {
    const std::lock_guard lock(mutex_);
    const TimeNs now = monotonic_ns();
    commits_.reset(now);
    blocks_.reset(now);
    first_after_mark_ = next_;
    committed_after_mark_ = 0;
    stream_breaks_ = 0;
    problem_.clear();
  }
  json watch() {
    const std::lock_guard lock(mutex_);
    const TimeNs now = monotonic_ns();
    return {{"gap_ms", commits_.ms(now)},        {"block_gap_ms", blocks_.ms(now)},
            {"sent", next_ - first_after_mark_}, {"committed", committed_after_mark_},
            {"stream_breaks", stream_breaks_},   {"problem", problem_}};
  }

  /// By number; to be read after end().
  const std::map<std::uint64_t, fabric::Outcome>& outcomes() const { return outcomes_; }

 private:
  void run() {
    for (TimeNs due = monotonic_ns();; due += period_) {
      const TimeNs now = monotonic_ns();
      if (due > now) std::this_thread::sleep_for(std::chrono::nanoseconds(due - now));
      due = std::max(due, now - period_);  // what was not sent while it was full is not made up for
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return ending_ || in_flight_ < max_in_flight; });
      if (ending_) return;
      ++in_flight_;
      const std::uint64_t number = next_++;
      lock.unlock();
      client_.submit({"set", {frame(number)}},
                     [this, number](fabric::Outcome outcome) { done(number, std::move(outcome)); });
    }
  }
  void done(std::uint64_t number, fabric::Outcome outcome) {
    const std::lock_guard lock(mutex_);
    --in_flight_;
    if (outcome.kind == fabric::Outcome::Kind::committed) {
      commits_.happened(monotonic_ns());
      if (number >= first_after_mark_) ++committed_after_mark_;
    } else {
      problem_ = outcome.message;
    }
    outcomes_.emplace(number, std::move(outcome));
    changed_.notify_all();
  }

  fabric::Client& client_;
  const TimeNs period_;
  std::unique_ptr<fabric::Client::Stream> stream_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool ending_ = false;
  std::size_t in_flight_ = 0;
  std::uint64_t next_ = 1, first_after_mark_ = 1, committed_after_mark_ = 0, stream_breaks_ = 0;
  Gap commits_, blocks_;
  std::string problem_;
  std::map<std::uint64_t, fabric::Outcome> outcomes_;
  std::thread thread_;
};

/// A peer's chain up to a block, with what is valid of our transactions. The client's stream checks the hashes.
struct Chain {
  struct Place {
    std::uint64_t block;
    std::string tx_id;
  };
  std::multimap<std::uint64_t, Place> applied;  ///< by number
  std::vector<std::string> hashes;              ///< of the blocks' headers
  std::uint64_t out_of_order = 0, last_applied = 0;
  std::string problem;
};

Chain read_chain(fabric::Client& client, std::uint64_t last_block) {
  Chain chain;
  std::mutex mutex;
  std::condition_variable changed;
  fabric::Client::StreamHandlers handlers;
  handlers.on_block = [&](const fabric::Block& block, std::string_view) {
    const std::lock_guard lock(mutex);
    chain.hashes.push_back(fabric::block_header_hash(block.number, block.previous_hash, block.data_hash));
    for (const fabric::Transaction& tx : block.transactions) {
      if (tx.code != 0 || tx.event_name != "set" || tx.config || tx.args.size() != 1) continue;
      const json call = json::parse(tx.args[0], nullptr, false);
      const json one = call.is_object() && call.contains("assets") ? call["assets"].at(0) : call;
      if (!one.is_object() || one.value("id", "") != asset) continue;
      const std::uint64_t number = std::stoull(one.value("msgType", ""));
      chain.applied.emplace(number, Chain::Place{block.number, tx.tx_id});
      if (number < chain.last_applied) ++chain.out_of_order;
      chain.last_applied = number;
    }
    changed.notify_one();
  };
  handlers.on_connection = [&](bool connected, const std::string& why) {
    const std::lock_guard lock(mutex);
    if (!connected) chain.problem = why;
    changed.notify_one();
  };
  const auto stream = client.blocks(0, std::move(handlers));
  std::unique_lock lock(mutex);
  const bool all = changed.wait_for(lock, std::chrono::seconds(120),
                                    [&] { return chain.hashes.size() > last_block || !chain.problem.empty(); });
  if (!all) chain.problem = fmt::format("{} of {} blocks came", chain.hashes.size(), last_block + 1);
  return chain;
}

/// What the contract says of our asset at a peer, once it is the last one of the chain.
bool state_agrees(fabric::Client& client, std::uint64_t number) {
  for (int tries = 0; tries < 50; ++tries) {
    const auto answer = client.evaluate({"get", {asset}});
    if (answer && answer->find('"' + std::to_string(number) + '"') != std::string::npos) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return false;
}

json check(const std::map<std::uint64_t, fabric::Outcome>& outcomes,
           const std::vector<std::unique_ptr<fabric::Client>>& peers) {
  using Kind = fabric::Outcome::Kind;
  json verdict{{"sent", outcomes.size()},
               {"peers", peers.size()},
               {"missing", 0},
               {"twice", 0},
               {"refused_but_applied", 0},
               {"out_of_order", 0},
               {"states_that_differ", 0},
               {"problems", json::array()}};
  std::map<Kind, std::uint64_t> kinds;
  std::uint64_t last_block = 0;
  for (const auto& [number, outcome] : outcomes) {
    ++kinds[outcome.kind];
    last_block = std::max(last_block, outcome.block);
  }
  verdict["committed"] = kinds[Kind::committed];
  verdict["open"] = kinds[Kind::unavailable];
  verdict["refused"] = kinds[Kind::refused] + kinds[Kind::overloaded];
  verdict["invalidated"] = kinds[Kind::invalidated];
  const auto count = [&](const char* what) { verdict[what] = verdict[what].get<std::uint64_t>() + 1; };
  const auto say = [&](const std::string& what) {
    if (verdict["problems"].size() < 20) verdict["problems"].push_back(what);
  };
  std::vector<std::string> hashes;
  for (const auto& peer : peers) {
    const Chain chain = read_chain(*peer, last_block);
    if (!chain.problem.empty()) say(chain.problem);
    hashes.resize(hashes.empty() ? chain.hashes.size() : std::min(hashes.size(), chain.hashes.size()));
    for (std::size_t i = 0; i < hashes.size(); ++i) {
      if (hashes[i].empty()) hashes[i] = chain.hashes[i];
      if (hashes[i] != chain.hashes[i]) say(fmt::format("block {} is not the same at all peers", i));
    }
    for (const auto& [number, outcome] : outcomes) {
      const auto [begin, end] = chain.applied.equal_range(number);
      const auto times = std::distance(begin, end);
      if (times > 1) count("twice");
      if (outcome.kind == Kind::committed &&
          (times == 0 || begin->second.block != outcome.block || begin->second.tx_id != outcome.tx_id)) {
        count("missing");
        say(fmt::format("{} was confirmed in block {} and is not there", number, outcome.block));
      }
      if (times > 0 && outcome.kind != Kind::committed && outcome.kind != Kind::unavailable) {
        count("refused_but_applied");
        say(fmt::format("{} was refused ({}) and is in block {}", number, outcome.message, begin->second.block));
      }
    }
    verdict["out_of_order"] = chain.out_of_order;
    verdict["applied"] = chain.applied.size();
    verdict["blocks"] = chain.hashes.size();
    if (!state_agrees(*peer, chain.last_applied)) count("states_that_differ");
  }
  return verdict;
}

Result<std::unique_ptr<fabric::Client>> connect(const std::string& file) {
  auto ledger = fabric::load_ledger_config(file);
  if (!ledger) return ledger.error();
  return fabric::Client::create(std::move(*ledger));
}

void say(const json& line) {
  std::printf("%s\n", line.dump().c_str());
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Load on a ledger whose parts are killed meanwhile"};
  std::string config;
  std::vector<std::string> peers;
  double rate_hz = 50;
  app.add_option("--config", config, "[ledger] and [[orderer]] of the load's client")->required();
  app.add_option("--peer", peers, "[ledger] of each peer whose chain is read at the end")->required();
  app.add_option("--rate", rate_hz, "Transactions a second")->check(CLI::Range(1.0, 1000.0));
  CLI11_PARSE(app, argc, argv);
  const auto client = connect(config);
  if (!client) return std::fprintf(stderr, "%s\n", client.error().message.c_str()), 1;
  std::vector<std::unique_ptr<fabric::Client>> readers;
  for (const std::string& peer : peers) {
    auto reader = connect(peer);
    if (!reader) return std::fprintf(stderr, "%s\n", reader.error().message.c_str()), 1;
    readers.push_back(std::move(*reader));
  }
  Load load(**client, rate_hz);
  load.mark();
  say({{"ready", true}});
  for (std::string line; std::getline(std::cin, line);) {
    if (line == "mark") {
      load.mark();
      say({{"marked", true}});
    } else if (line == "watch") {
      say(load.watch());
    } else if (line == "end") {
      load.end();
      say(check(load.outcomes(), readers));
      return 0;
    }
  }
  return 1;
}
