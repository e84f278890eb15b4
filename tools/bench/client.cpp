// One side of a two-way exchange as Ledgerline does it: agent's batching and pacing of frames over the ledger client
// that agent and ground use. Started by ledgerline bench.
#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "chaincode/endorser/shell/service.hpp"
#include "common/base/log.hpp"
#include "common/fabric/blocks/block_subscription.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/rt/histogram.hpp"
#include "common/verification/calls.hpp"
#include "onboard/agent/core/outbox/batcher.hpp"
#include "onboard/agent/shell/ledger_follower.hpp"
#include "tools/bench/exchange.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::bench;

constexpr TimeNs tick_ns = 100 * ns_per_ms;  // for signals and progress
constexpr std::uint64_t boot_id = 1;

void print(const nlohmann::json& line) {
  fmt::print("{}\n", line.dump());
  std::fflush(stdout);
}

/// A side's streams: what they are called on the ledger, and in the messages.
struct Names {
  std::string host, asset, topic;
  std::string id(std::uint64_t stream) const { return fmt::format("{}{}/{}", host, stream + 1, asset); }
};
const Names of_a{"tello", "odom", "/odom"}, of_b{"ground", "ori_odom", "/ori_odom"};

class Side {
 public:
  Side(bool is_a, Schedule schedule, std::unique_ptr<fabric::Client> client)
      : is_a_(is_a),
        schedule_(schedule),
        own_(is_a ? of_a : of_b),
        others_(is_a ? of_b : of_a),
        account_(schedule, true),
        batcher_({}, drones(schedule, own_), 1),
        newest_(static_cast<std::size_t>(schedule.streams)),
        client_(std::move(client)) {
    for (std::uint64_t k = 0; k < newest_.size(); ++k) streams_[others_.id(k)] = k;
    fabric::Client::StreamHandlers handlers;
    handlers.on_block = [this](const fabric::Block& block, std::string_view) { mailbox_.put_in_turn(block); };
    handlers.on_connection = [this](bool connected, const std::string& why) {
      mailbox_.put(agent::StreamState{connected, why});
    };
    blocks_.open(*client_, std::move(handlers));
  }
  ~Side() { mailbox_.close(); }
  Side(const Side&) = delete;
  Side& operator=(const Side&) = delete;

  Status wait_for_blocks(TimeNs limit_ns) {
    const TimeNs until_ns = monotonic_ns() + limit_ns;
    while (!connected_ && !stop_requested) {
      if (monotonic_ns() > until_ns) return Error{"no block stream: " + why_};
      turn(monotonic_ns() + tick_ns);
    }
    print({{"ready", true}, {"pid", ::getpid()}});
    return done;
  }

  void send_all() {
    const TimeNs start_ns = monotonic_ns();
    const TimeNs end_ns = start_ns + from_seconds(schedule_.length_s());
    std::uint64_t n = 0;
    std::uint64_t answers_before = 0;
    TimeNs next_progress_ns = start_ns;
    while (!stop_requested && !account_.complete() && monotonic_ns() < end_ns) {
      turn(start_ns + schedule_.due_ns(n));
      const TimeNs now = monotonic_ns();
      for (; now >= start_ns + schedule_.due_ns(n); ++n) {
        if (n == schedule_.first) {
          answers_before = account_.answers();
          print({{"measuring", true}});
        }
        if (n == schedule_.first + schedule_.count) {
          print({{"measured", true}, {"answers", account_.answers() - answers_before}});
        }
        account_.sent(now, n);
        add(now, n, now);
      }
      submit();
      if (now < next_progress_ns) continue;
      next_progress_ns = now + ns_per_s;
      print({{"progress", {{"sent", account_.sent()}, {"answered", account_.answered()}}}});
    }
    account_.end(monotonic_ns());
  }

  void answer() {
    while (!stop_requested) turn(monotonic_ns() + tick_ns);
  }

  void print_result() const {
    constexpr std::size_t per_line = 1000;
    const auto& times = account_.times();
    for (std::size_t i = 0; i < times.size(); i += per_line) {
      nlohmann::json us = nlohmann::json::array();
      for (std::size_t k = i; k < std::min(times.size(), i + per_line); ++k) us.push_back(times[k] / ns_per_us);
      print({{"latencies_us", us}});
    }
    const auto& tx = batcher_.transactions();
    print({{"result",
            {{"sent", account_.sent()},
             {"answered", account_.answered()},
             {"replaced", account_.replaced()},
             {"transactions", tx.committed},
             {"blocks", blocks_taken_},
             {"ordered_blocks_confirmed_after_ms", blocks_.confirmed_after_ms()},
             {"failed", tx.invalidated + tx.refused + tx.unavailable},
             {"why", why_}}}});
  }

 private:
  static std::vector<agent::DroneName> drones(const Schedule& schedule, const Names& names) {
    std::vector<agent::DroneName> list;
    for (int k = 0; k < schedule.streams; ++k) {
      list.push_back({static_cast<DroneNumber>(k + 1), names.host + std::to_string(k + 1)});
    }
    return list;
  }

  /// Waits for news, at most until `until`, and acts on all of it.
  void turn(TimeNs until) {
    const TimeNs now = monotonic_ns();
    const TimeNs wait_ns = std::clamp(std::min(until, batcher_.due_ns(now)), now, now + tick_ns) - now;
    pollfd fd{.fd = mailbox_.wake_fd(), .events = POLLIN, .revents = 0};
    const timespec timeout{.tv_sec = 0, .tv_nsec = wait_ns};
    (void)::ppoll(&fd, 1, &timeout, nullptr);  // interrupted or not: the loop looks at everything
    for (agent::Event& event : mailbox_.pop_all()) {
      if (const auto* block = std::get_if<fabric::Block>(&event)) {
        on_block(*block);
      } else if (const auto* ended = std::get_if<agent::CallEnded>(&event)) {
        (void)batcher_.finished(monotonic_ns(), ended->call_number, ended->outcome);
        if (ended->outcome.kind != fabric::Outcome::Kind::committed) why_ = ended->outcome.message;
      } else if (const auto* state = std::get_if<agent::StreamState>(&event)) {
        connected_ = state->connected;
        if (!connected_) why_ = state->why;
      }
      submit();
    }
    submit();
  }

  void on_block(const fabric::Block& block) {
    ++blocks_taken_;
    for (const fabric::Transaction& tx : block.transactions) {
      if (tx.code != 0 || tx.config || tx.event_name != contract::set) continue;
      SetCall call;
      if (tx.args.size() != 1 || !parse_message(tx.args[0], call)) continue;
      for (const Asset& asset : call.assets()) {
        const auto stream = streams_.find(asset.id());
        Message message;
        if (stream == streams_.end() || !read_message(asset.msg_data(), message)) continue;
        std::uint64_t& newest = newest_[stream->second];  // plus one
        if (message.n < newest) continue;                 // repeated in a later frame
        newest = message.n + 1;
        const TimeNs now = monotonic_ns();
        if (is_a_) {
          (void)account_.answered(now, message.n, message.stamp_ns);
        } else {
          add(now, message.n, message.stamp_ns);
        }
      }
    }
  }

  void add(TimeNs now, std::uint64_t n, TimeNs stamp_ns) {
    StateSample sample;
    sample.drone = static_cast<DroneNumber>(n % newest_.size() + 1);
    sample.boot_id = boot_id;
    sample.sequence = n + 1;
    sample.stamp_ns = stamp_ns;
    batcher_.add(now, sample);
  }

  void submit() {
    const auto frame = batcher_.next(monotonic_ns());
    if (!frame) return;
    client_->submit(encode(*frame), [this, number = frame->number](fabric::Outcome outcome) {
      mailbox_.put(agent::CallEnded{number, std::move(outcome)});
    });
  }

  /// As agent::encode_batch does, with the exchange's messages in place of ROS 2's.
  fabric::Call encode(const agent::StateBatch& frame) const {
    SetCall call;
    call.set_stream(true);
    for (const auto* samples : {&frame.samples, &frame.repeated}) {
      for (const StateSample& sample : *samples) {
        Asset* asset = call.add_assets();
        asset->set_id(own_.id(sample.drone - 1u));
        asset->set_msg_type("nav_msgs/msg/Odometry");
        asset->set_msg_data(write_message({sample.sequence - 1, sample.stamp_ns}, own_.topic));
      }
    }
    return {.function = contract::set,
            .args = {call.SerializeAsString()},
            .reported_by_block = true,
            .need = verification::batch_need()};
  }

  const bool is_a_;
  const Schedule schedule_;
  const Names own_, others_;
  Account account_;
  agent::Batcher batcher_;
  std::map<std::string, std::uint64_t> streams_;
  std::vector<std::uint64_t> newest_;
  std::uint64_t blocks_taken_ = 0;
  bool connected_ = false;
  std::string why_;

  // In this order: the threads and streams below use what is above, and are ended first.
  agent::Mailbox mailbox_;
  std::unique_ptr<fabric::Client> client_;
  fabric::BlockSubscription blocks_{{}};
};

Status run(const std::string& role, const std::string& config_file, const std::string& schedule_text) {
  auto schedule = read_schedule(schedule_text);
  if (!schedule) return schedule.error();
  auto config = Config::load(config_file);
  if (!config) return config.error();
  auto ledger = fabric::ledger_config(*config);
  const endorser::Settings within = endorser::read_own_endorser_settings(*config);
  if (auto status = config->finish(); !status) return status;
  if (!ledger) return ledger.error();
  if (auto s = endorser::start_own_endorser(within, *ledger); !s) return s;
  auto client = fabric::Client::create(verification::for_contract(std::move(ledger).value()));
  if (!client) return client.error();
  Side side(role == "a", *schedule, std::move(client).value());
  constexpr TimeNs start_limit_ns = 20 * ns_per_s;
  if (auto status = side.wait_for_blocks(start_limit_ns); !status) return status;
  if (role == "a") {
    side.send_all();
  } else {
    side.answer();
  }
  side.print_result();
  return done;
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line("two-way", "One side of `ledgerline bench two-way`, which starts it", "");
  std::string role, config, schedule;
  line.option("--role", role, "a asks, b answers").required().one_of({"a", "b"});
  line.option("--config", config, "TOML with [ledger] and [[orderer]]").required();
  line.option("--schedule", schedule, "JSON").required();
  if (const auto end = line.parse(argc, argv)) return *end;
  init_log("two-way " + role);
  catch_stop_signals();
  return exit_code(run(role, config, schedule));
}
