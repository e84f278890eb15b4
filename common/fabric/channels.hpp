#pragma once
#include <string>
#include <vector>

#include "common/config/config.hpp"
#include "common/fabric/client/client.hpp"

/// The channels of a program that is on several at once: agent and ground.
namespace ledgerline::fabric {

/// What a file says of its channels: that of [ledger] comes first, then one for each [[channel]]. What a [[channel]]
/// leaves empty is as in [ledger].
struct Channels {
  struct Table {
    std::string name, contract;
    std::string config_block{}, endpoint{}, tls_ca{}, server_name{};
    ClientConfig::TlsPair tls_pair{};
  };
  /// Of an [[orderer]], [[endorser]] or [[peer]]: the channels that it is for; empty: each that is at the endpoint of
  /// [ledger].
  using For = std::vector<std::string>;

  std::vector<Table> all;
  std::vector<For> orderers, endorsers, peers;
  std::vector<std::size_t> of_drone;  ///< index into `all`, for each [[drone]] in the file's order

  bool several() const { return all.size() > 1; }
  std::vector<std::string> names() const;
  /// Those that tables name themselves.
  std::vector<ClientConfig::TlsPair> tls_pairs() const;
};

/// Reads [[channel]], and the keys that say who belongs to which: `channel` of [[drone]], `channels` of [[orderer]],
/// [[endorser]] and [[peer]]. What is wrong is in config.finish(): names that are there twice, a channel without a
/// drone.
Channels read_channels(Config& config);

/// Whether an [[orderer]], [[endorser]] or [[peer]] is used for that channel.
bool is_for(const Channels::For& named, const Channels::Table& channel);

/// A client's config for each channel: `ledger`, which is that of [ledger], with what its [[channel]] says otherwise.
/// With one channel it is `ledger` itself. An error names the channel whose config block cannot be read.
Result<std::vector<ClientConfig>> each_channel(const ClientConfig& ledger, const Channels& channels);

/// A program's file of one of its channels, such as a checkpoint: that of [ledger] has the name as it is said, so that
/// it stays the same file when a channel is added; the others' end in "-CHANNEL". Empty where `path` is.
std::string file_of_channel(const std::string& path, const Channels& channels, std::size_t channel);

/// What went wrong with the client of one of them.
Error of_channel(const ClientConfig& config, const Error& why);

/// Fabric's rule: a-z first, then a-z, 0-9, . and -
bool is_channel_name(const std::string& name);

}  // namespace ledgerline::fabric
