#pragma once
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "chaincode/node/core/tx/messages.hpp"
#include "common/configtx.pb.h"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "msp/identities.pb.h"

/// A chain of the embedded node's making, with real certificates, for tests of those who validate it.
namespace ledgerline::fabric {

inline constexpr auto library = crypto::Library::libcrypto;

struct Organisation {
  std::string msp_id;
  crypto::KeyAndCertificate ca;
  explicit Organisation(std::string id) : msp_id(std::move(id)), ca(*crypto::make_ca("ca." + msp_id, msp_id)) {}
  crypto::SigningIdentity member(const std::string& unit) const {
    const auto made =
        crypto::issue(ca, {.common_name = unit + "." + msp_id, .organization = msp_id, .unit = unit, .sans = {}});
    msp::SerializedIdentity serialized;
    serialized.set_mspid(msp_id);
    serialized.set_id_bytes(made->certificate_pem);
    return {{msp_id, "CN=" + unit}, serialized.SerializeAsString(), *crypto::make_signer(library, made->key_pem)};
  }
  crypto::MspRoot root() const { return {msp_id, ca.certificate_pem}; }
};

/// Block 0 configures the channel with the orderers of `first_`.
class SignedChain {
 public:
  SignedChain() { add(config_of(first_)); }

  std::string config_of(const Organisation& orderers) const {
    node::CoreConfig config;
    config.organisations = {peers_.root()};
    config.orderers = orderers.root();
    return node::make_config_envelope(config, orderer_);
  }
  /// The next block; `signer`: null: nobody.
  const common::Block& add(const std::string& envelope, const crypto::SigningIdentity* signer = nullptr,
                           std::uint64_t last_config = 0) {
    const node::ChainEnd end{chain_.size(), chain_.empty() ? "" : fabric::header_hash(chain_.back().header())};
    common::Block block = node::make_block(end, {envelope});
    if (signer != nullptr) sign(block, *signer, last_config);
    return chain_.emplace_back(std::move(block));
  }
  static void sign(common::Block& block, const crypto::SigningIdentity& signer, std::uint64_t last_config = 0) {
    ASSERT_TRUE(node::sign_block(block, signer));
    if (last_config == 0) return;
    common::OrdererBlockMetadata value;
    value.mutable_last_config()->set_index(last_config);
    common::Metadata metadata;
    ASSERT_TRUE(metadata.ParseFromString(block.metadata().metadata(common::SIGNATURES)));
    metadata.set_value(value.SerializeAsString());
    const auto& header = block.header();
    metadata.mutable_signatures(0)->set_signature(
        *signer.signer->sign(metadata.value() + metadata.signatures(0).signature_header() +
                             block_header_bytes(header.number(), header.previous_hash(), header.data_hash())));
    block.mutable_metadata()->set_metadata(common::SIGNATURES, metadata.SerializeAsString());
  }

  const Organisation peers_{"Org1MSP"}, first_{"OrdererMSP"}, second_{"OtherMSP"};
  const crypto::SigningIdentity orderer_ = first_.member("orderer"), other_ = second_.member("orderer");
  std::vector<common::Block> chain_;
};

}  // namespace ledgerline::fabric
