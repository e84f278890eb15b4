#pragma once
#include <atomic>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "common/bridge/core/downlink.hpp"
#include "common/bridge/core/uplink.hpp"
#include "common/dds/raw.hpp"
#include "common/fabric/blocks/block_subscription.hpp"
#include "common/fabric/client/client.hpp"
#include "common/verification/control_records.hpp"

namespace ledgerline::bridge {

/// Downlink with its writers of DDS, under one lock, which no thread of DDS's may take. Any other thread.
class DownlinkWriters {
 public:
  /// `trusted` must outlive it.
  DownlinkWriters(DownlinkConfig config, crypto::MspRegistry& trusted, dds::ParticipantPtr participant)
      : participant_(std::move(participant)), downlink_(std::move(config), trusted) {}

  void on_block(const fabric::Block& block);
  /// Publishes the latched values that the ledger has; an error: it does not say.
  Status read_latched(const verification::Evaluate& evaluate);
  /// Adds its part of Bridge::status().
  void report_to(nlohmann::json& status, nlohmann::json& topics);

 private:
  struct Output {
    std::string type;
    std::optional<dds::RawWriter> writer;
    TimeNs try_again_ns = 0;
  };
  void publish(const std::vector<Downlink::Delivery>& deliveries);
  Output* output_for(const Downlink::Delivery& delivery);

  const dds::ParticipantPtr participant_;
  std::mutex mutex_;
  Downlink downlink_;
  std::vector<Downlink::Delivery> deliveries_;
  std::map<std::string, Output> outputs_;  ///< by topic
  TimeNs next_warning_ns_ = 0;
};

/// The bridge's I/O around Uplink and Downlink, for one channel. DDS's threads put messages into Uplink; a thread of
/// its own submits; the block stream's thread steps Downlink and publishes. Uplink and Downlink have a lock each, and
/// none of DDS's threads takes Downlink's, under which readers and writers of DDS are used.
class Bridge {
 public:
  /// `trusted` must outlive it. `ledger`: for this channel; the rules of `config` are all carried on it. `kept`: of
  /// this channel, read already.
  static Result<std::unique_ptr<Bridge>> create(const BridgeConfig& config, const fabric::ClientConfig& ledger,
                                                crypto::MspRegistry& trusted, dds::ParticipantPtr participant,
                                                fabric::StoredCheckpoint kept);
  ~Bridge() { end(); }

  /// Opens the block stream, publishes latched values of the ledger, then begins to carry. Ends early, with an error,
  /// when `quit`.
  Status start(const std::atomic<bool>& quit);
  /// Takes nothing more off DDS, waits a moment for what is on its way, and ends; status() can still be asked.
  void end();
  /// {channel, connected, topics, malformed_frames, unverified_transactions, topics_left_out}. Any thread.
  nlohmann::json status();

 private:
  struct Input {
    std::string type;
    std::size_t index = 0;  ///< in Uplink
    std::optional<dds::RawReader> reader;
    std::uint64_t dds_lost = 0, dds_refused = 0;  ///< as Uplink knows them
    dds::Qos qos{};
    std::map<std::string, std::string> unheard{};  ///< why writers of a type are not
    std::set<std::string> reported{};              ///< of these reasons
  };
  Bridge(const BridgeConfig& config, const fabric::ClientConfig& ledger, crypto::MspRegistry& trusted,
         dds::ParticipantPtr participant, std::unique_ptr<fabric::Client> client, std::unique_ptr<fabric::Client> bulk,
         fabric::StoredCheckpoint kept);
  Status open_named_topics();
  void on_seen(const dds::DiscoveredTopic& seen);
  void update_topics();
  void choose_type(const std::string& topic);
  void report_unheard(const dds::DiscoveredTopic& seen);
  void record_losses();
  void record_losses(Input& input);
  Status open_reader(const std::string& topic, const std::string& type, const dds::Qos& qos);
  void carry(const std::stop_token& stop);
  void submit(Uplink::Submit call);

  const std::vector<Rule> rules_;
  const std::string channel_;
  const dds::ParticipantPtr participant_;

  std::mutex up_mutex_;
  std::condition_variable up_wake_;
  Uplink uplink_;
  std::vector<dds::DiscoveredTopic> seen_;  ///< not yet looked at
  std::uint64_t seen_left_out_ = 0;
  TimeNs next_warning_ns_ = 0;

  DownlinkWriters down_;

  // The carrying thread's own.
  std::map<std::string, Input> inputs_;
  TimeNs next_losses_ns_ = 0;
  std::map<std::string, std::map<std::string, dds::Qos>> present_;  ///< types that have writers, by topic

  // Ended in the reverse of this order: their threads use all of the above.
  std::unique_ptr<fabric::Client> client_, bulk_;
  fabric::BlockSubscription blocks_;
  std::optional<dds::Discovery> discovery_;
  std::jthread carrier_;
};

}  // namespace ledgerline::bridge
