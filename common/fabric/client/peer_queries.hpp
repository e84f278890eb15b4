#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/fabric/client/client.hpp"
#include "common/fabric/validation/channel_config.hpp"

namespace ledgerline::fabric {

/// What a program asks the peer of its config directly, waiting at most the config's deadline: not a call of its own,
/// but about the peer. Any thread.
class PeerQuestions {
 public:
  static Result<std::unique_ptr<PeerQuestions>> create(ClientConfig config);
  ~PeerQuestions();

  /// The peer's protos.ProposalResponse to somebody's protos.SignedProposal.
  Result<std::string> propose(std::string_view signed_proposal);
  /// How many blocks the peer has of the channel.
  Result<std::uint64_t> height();
  /// A serialized common.Block of the channel.
  Result<std::string> block(std::uint64_t number);
  /// The channel's newest config block, as the peer reports it: a common.Block for read_channel_config. Nobody has
  /// validated it.
  Result<std::string> config_block();
  /// That, read.
  Result<ChannelConfig> channel_config();
  /// The payload of a peer's answer to a call of one of its own contracts ("qscc", "cscc", "_lifecycle"), with a
  /// channel or without (""); an error is the peer's word.
  Result<std::string> ask(const ChannelAndContract& where, const Call& call);

 private:
  struct State;
  explicit PeerQuestions(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace ledgerline::fabric
