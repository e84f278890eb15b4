#include "common/fabric/timeouts.hpp"

#include "common/base/log.hpp"
#include "common/common.pb.h"
#include "common/fabric/asking/peer_questions.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/validation/channel_config.hpp"

namespace ledgerline::fabric {
namespace {

Result<ChannelConfig> channel_of(const ClientConfig& config) {
  if (!config.config_block.empty()) {
    common::Block block;
    if (!block.ParseFromString(config.config_block)) return Error{"ledger.config_block: it is no block"};
    return read_channel_config(block);
  }
  const auto questions = PeerQuestions::create(config);
  return questions ? (*questions)->channel_config() : questions.error();
}

}  // namespace

Result<TimeNs> added_timeout(const ClientConfig& config) {
  if (!config.timeouts_of_channel) return TimeNs{0};
  const auto channel = channel_of(config);
  if (!channel) return Error{"ledger.timeouts: the channel's settings are not known: " + channel.error().message};
  if (!channel->batching) return Error{"ledger.timeouts: the channel's configuration has no BatchTimeout"};
  const TimeNs both_ns = both_ways_ns(channel->batching->timeout_ns, channel->batching->max_messages);
  spdlog::info(
      "blocks are cut {:g} s behind their first transaction, or at {}: a command may come {:g} s later than it "
      "would if each were cut at once, and limits are so much longer",
      to_seconds(channel->batching->timeout_ns), channel->batching->max_messages, to_seconds(both_ns));
  return both_ns;
}

Result<TimeNs> take_timeouts(ClientConfig& config) {
  const auto longer_ns = added_timeout(config);
  if (!longer_ns) return of_channel(config, longer_ns.error());
  config.deadline += std::chrono::milliseconds(*longer_ns / ns_per_ms);
  return longer_ns;
}

}  // namespace ledgerline::fabric
