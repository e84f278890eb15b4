#include <algorithm>
#include <functional>
#include <map>
#include <mutex>

#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "msp/identities.pb.h"

namespace ledgerline::crypto {
namespace {

constexpr std::string_view test_prefix = "test:";
constexpr std::size_t max_known = 1'000;  // members; a flight has a dozen

std::string signature_of(const IdentityName& name, std::string_view message) {
  std::string text;
  text.reserve(name.msp_id.size() + name.subject.size() + message.size() + 2);
  text.append(name.msp_id).append("\n").append(name.subject).append("\n").append(message);
  const Digest digest = sha256(text);
  return {digest.begin(), digest.end()};
}

class TestSigner final : public Signer {
 public:
  explicit TestSigner(IdentityName name) : name_(std::move(name)) {}
  Result<std::string> sign(std::string_view message) const override { return signature_of(name_, message); }

 private:
  IdentityName name_;
};

class TestVerifier final : public Verifier {
 public:
  explicit TestVerifier(IdentityName name) : name_(std::move(name)) {}
  bool verify(std::string_view message, std::string_view signature) const override {
    return signature_of(name_, message) == signature;
  }

 private:
  IdentityName name_;
};

class TestRegistry final : public MspRegistry {
 public:
  explicit TestRegistry(std::vector<std::string> msp_ids) : msp_ids_(std::move(msp_ids)) {}

  Result<std::shared_ptr<const Member>> member(std::string_view serialized, std::optional<std::int64_t>) override {
    const std::lock_guard lock(mutex_);
    if (const auto known = known_.find(serialized); known != known_.end()) return known->second;
    auto member = read(serialized);
    if (!member) return member;
    if (known_.size() >= max_known) known_.clear();
    known_.emplace(serialized, *member);
    return member;
  }

 private:
  Result<std::shared_ptr<const Member>> read(std::string_view serialized) const {
    msp::SerializedIdentity identity;
    if (!identity.ParseFromArray(serialized.data(), static_cast<int>(serialized.size()))) {
      return Error{"could not deserialize a SerializedIdentity"};
    }
    if (std::find(msp_ids_.begin(), msp_ids_.end(), identity.mspid()) == msp_ids_.end()) {
      return Error{"MSP " + printable(identity.mspid(), 200) + " is unknown"};
    }
    if (!identity.id_bytes().starts_with(test_prefix)) return Error{"could not decode the PEM structure"};
    const IdentityName name{identity.mspid(), identity.id_bytes().substr(test_prefix.size())};
    return std::make_shared<const Member>(
        Member{name, identity.id_bytes(), name.subject.starts_with("CN=Admin"), name.subject.starts_with("CN=peer"),
               name.subject.starts_with("CN=orderer"), std::make_shared<TestVerifier>(name)});
  }

  std::vector<std::string> msp_ids_;
  std::mutex mutex_;
  std::map<std::string, std::shared_ptr<const Member>, std::less<>> known_;  ///< by their bytes
};

}  // namespace

SigningIdentity make_test_identity(const IdentityName& name) {
  return {name, serialized_identity(name.msp_id, std::string(test_prefix) + name.subject),
          std::make_shared<TestSigner>(name)};
}

std::unique_ptr<MspRegistry> make_test_registry(std::vector<std::string> msp_ids) {
  return std::make_unique<TestRegistry>(std::move(msp_ids));
}

}  // namespace ledgerline::crypto
