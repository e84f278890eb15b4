#include "common/bridge/shell/bridges.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <random>
#include <set>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/config.hpp"
#include "common/rt/retry.hpp"

namespace ledgerline::bridge {
namespace {

constexpr std::chrono::milliseconds turn{10};
constexpr TimeNs first_pause_ns = 1 * ns_per_s, max_pause_ns = 30 * ns_per_s;

const std::string& channel_of(const Rule& rule, const fabric::ClientConfig& ledger) {
  return rule.channel.empty() ? ledger.where.channel : rule.channel;
}

/// Of a channel that is not [ledger]'s; empty: no topic of it names one.
Result<std::string> anchor_of(const std::string& channel, const BridgeConfig& config) {
  std::string file;
  for (const Rule& rule : config.rules) {
    if (rule.channel != channel || rule.config_block.empty()) continue;
    if (!file.empty() && file != rule.config_block)
      return Error{
          fmt::format("topics of channel {} name two config blocks: {} and {}", channel, file, rule.config_block)};
    file = rule.config_block;
  }
  if (file.empty()) return std::string();
  auto block = read_file(file);
  if (!block) return Error{fmt::format("config_block of channel {}: {}", channel, block.error().message)};
  return block;
}

void wait(const std::atomic<bool>& quit, TimeNs until_ns) {
  while (!quit && monotonic_ns() < until_ns) std::this_thread::sleep_for(turn);
}

}  // namespace

void warn_of_open_topics(const BridgeConfig& config) {
  for (const Rule& rule : config.rules) {
    if (!rule.from_ledger || rule.left_out || rule.from != anybody) continue;
    spdlog::warn("{} is taken from the ledger from any writer: its [[topic]] says from = \"*\"", rule.name);
  }
}

Result<std::unique_ptr<Bridges>> Bridges::create(const BridgeConfig& config,
                                                 const std::vector<fabric::ClientConfig>& ledgers,
                                                 crypto::MspRegistry& trusted, const dds::ParticipantPtr& participant) {
  if (const Status there = check_folder_of(config.status_file); !there)
    return Error{"[output] status: " + there.error().message};
  const fabric::ClientConfig& ledger = ledgers.front();
  std::set<std::string> channels;
  for (const Rule& rule : config.rules) {
    if (!rule.left_out) channels.insert(channel_of(rule, ledger));
  }
  std::unique_ptr<Bridges> made(new Bridges(config));
  for (const std::string& channel : channels) {
    BridgeConfig of_channel = config;
    for (Rule& rule : of_channel.rules) rule.left_out = rule.left_out || channel_of(rule, ledger) != channel;
    const auto named = std::ranges::find_if(ledgers, [&](const auto& one) { return one.where.channel == channel; });
    fabric::ClientConfig on_channel = named == ledgers.end() ? ledger : *named;
    if (channel != ledger.where.channel) {
      on_channel.where.channel = channel;
      auto anchor = anchor_of(channel, config);
      if (!anchor) return anchor.error();
      if (named == ledgers.end() || !anchor->empty()) on_channel.config_block = std::move(*anchor);
    }
    if (on_channel.config_block.empty()) spdlog::warn("channel {}: {}", channel, fabric::blocks_not_validated);
    auto kept = fabric::StoredCheckpoint::read(checkpoint_of(config, channel, ledger.where.channel), channel);
    if (!kept) return kept.error();
    auto bridge = Bridge::create(of_channel, on_channel, trusted, participant, std::move(*kept));
    if (!bridge) return bridge.error();
    made->bridges_.push_back(std::move(bridge).value());
  }
  return made;
}

Status Bridges::run(const std::atomic<bool>& quit, const std::function<void(const std::string& status)>& tell) {
  for (auto& each : bridges_) {
    if (auto status = each->start(quit); !status) return status;
  }
  while (!quit) {
    if (auto status = write_status(tell); !status) return status;
    wait(quit, monotonic_ns() + config_.status_period_ns);
  }
  for (auto& each : bridges_) each->end();
  return write_status(tell);
}

Status Bridges::write_status(const std::function<void(const std::string& status)>& tell) {
  nlohmann::json channels = nlohmann::json::array();
  for (const auto& each : bridges_) channels.push_back(each->status());
  const nlohmann::json status = {{"bridge", config_.name},
                                 {"pid", ::getpid()},
                                 {"time_ns", monotonic_ns()},
                                 {"period_ms", config_.status_period_ns / ns_per_ms},
                                 {"channels", channels}};
  const std::string line = status.dump();
  if (!config_.status_file.empty()) {
    const std::string fresh = config_.status_file + ".new";
    if (auto written = write_file(fresh, line + "\n"); !written) return written;
    std::error_code error;
    std::filesystem::rename(fresh, config_.status_file, error);
    if (error) return Error{fmt::format("{}: {}", config_.status_file, error.message())};
  }
  tell(line);
  return done;
}

Result<std::unique_ptr<BesideBridges>> BesideBridges::create(Config& config, const fabric::ClientConfig& program,
                                                             BridgeConfig bridge, dds::ParticipantPtr participant) {
  if (!bridge.carries_something()) return std::unique_ptr<BesideBridges>{};
  // The bridge's own, with a deadline for big messages.
  auto ledger = fabric::ledger_config(config);
  if (!ledger) return ledger.error();
  ledger->identity = program.identity;
  ledger->tls_in_use = program.tls_in_use;
  auto ledgers = fabric::each_channel(*ledger, fabric::read_channels(config));
  if (!ledgers) return ledgers.error();
  auto trusted = fabric::msp_registry(config);
  if (!trusted) return trusted.error();
  return std::unique_ptr<BesideBridges>(new BesideBridges(std::move(bridge), std::move(ledgers).value(),
                                                          std::move(trusted).value(), std::move(participant)));
}

BesideBridges::BesideBridges(BridgeConfig config, std::vector<fabric::ClientConfig> ledgers,
                             std::unique_ptr<crypto::MspRegistry> trusted, dds::ParticipantPtr participant)
    : config_(std::move(config)),
      ledgers_(std::move(ledgers)),
      trusted_(std::move(trusted)),
      participant_(std::move(participant)),
      thread_([this] { carry(); }) {
  warn_of_open_topics(config_);
}

BesideBridges::~BesideBridges() {
  quit_ = true;
  thread_.join();
}

void BesideBridges::carry() {
  ::pthread_setname_np(::pthread_self(), "bridge");
  BackOff pause(first_pause_ns, max_pause_ns);
  Random random(std::random_device{}());
  while (!quit_) {
    const TimeNs begin_ns = monotonic_ns();
    auto bridges = Bridges::create(config_, ledgers_, *trusted_, participant_);
    const Status status = bridges ? (*bridges)->run(quit_, [](const std::string&) {}) : Status(bridges.error());
    if (status || quit_) continue;
    spdlog::error("the bridge starts again: {}", status.error().message);
    if (monotonic_ns() - begin_ns > max_pause_ns) pause.succeeded();  // a start gives up before
    wait(quit_, monotonic_ns() + pause.next(random));
  }
}

}  // namespace ledgerline::bridge
