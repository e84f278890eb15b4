#include "common/fabric/validation/block_validator.hpp"

#include <fmt/format.h>

#include <set>
#include <vector>

#include "common/base/check.hpp"
#include "common/common.pb.h"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"

namespace ledgerline::fabric {
namespace {

constexpr std::size_t max_configs = 1'000;  // since the anchor, at once; a channel has a few in a year

/// What the orderers signed beside the header.
struct OrdererMetadata {
  common::Metadata metadata;
  std::uint64_t last_config = 0;
};
Result<OrdererMetadata> read_orderer_metadata(const common::Block& block) {
  OrdererMetadata out;
  common::OrdererBlockMetadata value;
  if (block.metadata().metadata_size() <= common::SIGNATURES ||
      !out.metadata.ParseFromString(block.metadata().metadata(common::SIGNATURES)) || out.metadata.signatures().empty())
    return Error{"no orderer has signed it"};
  if (!value.ParseFromString(out.metadata.value())) return Error{"what its orderers signed is malformed"};
  out.last_config = value.last_config().index();
  return out;
}

/// Members of the orderers' organisations who signed, each once.
std::vector<PolicySigner> signers_of(const common::Block& block, const common::Metadata& metadata,
                                     crypto::MspRegistry& orderers) {
  const common::BlockHeader& header = block.header();
  const std::string bytes = block_header_bytes(header.number(), header.previous_hash(), header.data_hash());
  std::vector<PolicySigner> signers;
  std::set<std::string> known;
  for (const common::MetadataSignature& signature : metadata.signatures()) {
    common::SignatureHeader who;
    if (!who.ParseFromString(signature.signature_header()) || known.contains(who.creator())) continue;
    // Whenever: Fabric does not ask for the time either, and an old block stays one.
    const auto member = orderers.member(who.creator(), std::nullopt);
    if (!member ||
        !(*member)->verifier->verify(metadata.value() + signature.signature_header() + bytes, signature.signature()))
      continue;
    known.insert(who.creator());
    signers.push_back({(*member)->name.msp_id, (*member)->peer, (*member)->orderer});
  }
  return signers;
}

Status check_signatures(const common::Block& block, const OrdererMetadata& signed_part, const ChannelConfig& config,
                        crypto::MspRegistry& orderers) {
  const std::vector<PolicySigner> signers = signers_of(block, signed_part.metadata, orderers);
  if (satisfies(config.block_validation, signers)) return done;
  return Error{
      fmt::format("its orderers' signatures do not satisfy the channel's policy ({} of them count)", signers.size())};
}

}  // namespace

bool is_config(const common::Block& block) {
  common::Envelope envelope;
  common::Payload payload;
  common::ChannelHeader header;
  return block.data().data_size() == 1 && envelope.ParseFromString(block.data().data(0)) &&
         payload.ParseFromString(envelope.payload()) && header.ParseFromString(payload.header().channel_header()) &&
         header.type() == common::CONFIG;
}

Result<BlockValidator> BlockValidator::from(std::string_view anchor, const std::string& channel,
                                            crypto::Library library) {
  return from(anchor, channel, registry_of(library));
}

BlockValidator::MakeRegistry BlockValidator::registry_of(crypto::Library library) {
  return [library](std::vector<crypto::MspRoot> roots) { return crypto::make_msp_registry(library, std::move(roots)); };
}

Result<BlockValidator> BlockValidator::from(std::string_view anchor, const std::string& channel,
                                            MakeRegistry make_registry) {
  BlockValidator validator;
  validator.channel_ = channel;
  validator.make_registry_ = std::move(make_registry);
  common::Block block;
  if (!parse(block, anchor)) return Error{"the config block cannot be parsed"};
  if (auto status = validator.follow(block); !status) return status.error();
  return validator;
}

Status BlockValidator::follow(const common::Block& block) {
  if (auto decoded = decode_block(block); !decoded) return decoded.error();  // its data match its header
  auto config = read_channel_config(block);
  if (!config) return config.error();
  if (config->channel != channel_)
    return Error{fmt::format("config block {} is of channel {}, not of {}", config->block, config->channel, channel_)};
  config_hash_ = header_hash(block.header());
  config_ = std::move(*config);
  orderers_ = make_registry_(config_.orderers);
  LEDGERLINE_CHECK(orderers_, "a configuration has a registry of its orderers", config_.block);
  LEDGERLINE_CHECK(config_.block == block.header().number(), "a configuration is of its block", config_.block,
                   block.header().number());
  return done;
}

Status BlockValidator::validate(const common::Block& block) {
  const std::uint64_t number = block.header().number();
  const auto wrong = [&](const std::string& why) { return Error{fmt::format("block {}: {}", number, why)}; };
  if (number == config_.block)
    return header_hash(block.header()) == config_hash_ ? Status(done)
                                                       : wrong("it is not the configuration that is known");
  LEDGERLINE_CHECK(orderers_, "blocks are validated by a configuration that is known", number);
  if (number < config_.block) return wrong("it is older than the configuration that is known");
  const auto signed_part = read_orderer_metadata(block);
  if (!signed_part) return wrong(signed_part.error().message);
  if (Status status = check_signatures(block, *signed_part, config_, *orderers_); !status)
    return wrong(status.error().message);
  if (is_config(block)) return follow(block);
  if (signed_part->last_config == config_.block) return done;
  return wrong(fmt::format("the channel was reconfigured in block {}, and block {} is known", signed_part->last_config,
                           config_.block));
}

bool BlockValidator::is_signed(const common::Block& block) const {
  LEDGERLINE_CHECK(orderers_, "signatures are checked by a configuration that is known");
  const auto signed_part = read_orderer_metadata(block);
  return signed_part && check_signatures(block, *signed_part, config_, *orderers_);
}

Status BlockValidator::catch_up(const common::Block& newest, const Fetch& fetch) {
  const auto signed_part = read_orderer_metadata(newest);
  const std::uint64_t height = newest.header().number();
  if (!signed_part)
    return height <= config_.block ? Status(done)
                                   : Error{fmt::format("block {}: {}", height, signed_part.error().message)};
  if (signed_part->last_config > height)
    return Error{fmt::format("block {} names a later configuration, {}", height, signed_part->last_config)};
  // Back from the newest: each block before a config block says which one came before that.
  struct Step {
    common::Block before, config;
  };
  std::vector<Step> steps;
  std::uint64_t number = signed_part->last_config;
  while (number > config_.block) {
    if (steps.size() == max_configs) return Error{"the channel was configured too often since the trust anchor"};
    auto config = fetch(number);
    if (!config) return config.error();
    auto before = fetch(number - 1);
    if (!before) return before.error();
    std::uint64_t earlier = config_.block;
    if (number - 1 > config_.block) {
      const auto signed_before = read_orderer_metadata(*before);
      if (!signed_before) return Error{fmt::format("block {}: {}", number - 1, signed_before.error().message)};
      earlier = signed_before->last_config;
    }
    if (earlier >= number) return Error{fmt::format("block {} names a later configuration", number - 1)};
    steps.push_back({std::move(*before), std::move(*config)});
    number = earlier;
  }
  for (auto step = steps.rbegin(); step != steps.rend(); ++step) {
    if (auto status = validate(step->before); !status) return status;
    if (auto status = validate(step->config); !status) return status;
  }
  return done;
}

}  // namespace ledgerline::fabric
