#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/validation/channel_config.hpp"

namespace common {
class Block;
}

namespace ledgerline::fabric {

/// Whether the block configures its channel, or says so.
bool is_config(const common::Block& block);

/// Whether a block was made by the channel's orderers: their signature over its header, by the policy of the channel's
/// own configuration, which is followed from one config block, the trust anchor, on. Fabric signs neither a block's
/// flags nor which blocks a peer leaves out. Pure but for the registry's cache; one thread.
class BlockValidator {
 public:
  /// Who checks the signatures of these organisations' members; a campaign has test signers.
  using MakeRegistry = std::function<std::unique_ptr<crypto::MspRegistry>(std::vector<crypto::MspRoot>)>;
  /// `anchor`: a common.Block with the channel's configuration, from somebody who is trusted.
  static Result<BlockValidator> from(std::string_view anchor, const std::string& channel, MakeRegistry make_registry);
  static Result<BlockValidator> from(std::string_view anchor, const std::string& channel, crypto::Library library);
  static MakeRegistry registry_of(crypto::Library library);

  /// Enough orderers must have signed the block's header, and they must say that the configuration that is known is the
  /// newest. (Whether its data match the header decode_block says.) A config block, once it is validated, is the
  /// configuration from then on. The one that is known passes by its hash; what is before it does not pass.
  Status validate(const common::Block& block);

  /// Whether enough orderers have signed the header, by the configuration that is known, whatever else they say;
  /// neither data nor place count, and no configuration is followed.
  bool is_signed(const common::Block& block) const;

  /// For a block that is far ahead of the configuration that is known: validates each config block between, by those
  /// before it, which `fetch` brings by their numbers. After an error some of them may be known.
  using Fetch = std::function<Result<common::Block>(std::uint64_t number)>;
  Status catch_up(const common::Block& block, const Fetch& fetch);

  /// Number of the config block that counts.
  std::uint64_t config_block_number() const { return config_.block; }
  const ChannelConfig& channel_config() const { return config_; }
  /// Of everybody in the channel, by that configuration.
  std::unique_ptr<crypto::MspRegistry> make_members() const { return make_registry_(everybody(config_)); }

 private:
  BlockValidator() = default;
  Status follow(const common::Block& block);

  std::string channel_;
  MakeRegistry make_registry_;
  ChannelConfig config_;
  std::string config_hash_;  ///< of its block's header
  std::unique_ptr<crypto::MspRegistry> orderers_;
};

}  // namespace ledgerline::fabric
