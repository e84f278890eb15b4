#include "chaincode/service/contract_stub.hpp"

#include <algorithm>
#include <utility>

#include "common/crypto/crypto.hpp"

namespace ledgerline::chaincode {
namespace {

struct Caller {
  crypto::IdentityName name;
  bool admin = false;
};

Result<Caller> caller_of(const std::string& creator) {
  auto read = crypto::read_serialized(creator);
  if (!read) return Error{"the creator's certificate: " + read.error().message};
  const bool is_admin = std::ranges::count(read->certificate.units, "admin") > 0;
  return Caller{std::move(read->name), is_admin};
}

class ContractStub final : public Stub {
 public:
  ContractStub(shim::Stub& stub, Caller caller) : stub_(stub), caller_(std::move(caller)) {}

  Result<std::optional<std::string>> get_state(const std::string& key) override { return stub_.get_state(key); }
  Status put_state(const std::string& key, const std::string& value) override { return stub_.put_state(key, value); }
  Status put_policy(const std::string& key, const std::string& msp_id) override {
    return stub_.set_state_validation_parameter(key, shim::peer_policy(msp_id));
  }
  Result<std::vector<KeyValue>> get_range(const std::string& start, const std::string& end,
                                          std::size_t limit) override {
    auto found = stub_.get_range(start, end, limit);
    if (!found) return found.error();
    std::vector<KeyValue> out;
    for (auto& entry : *found) out.push_back({std::move(entry.key), std::move(entry.value)});
    return out;
  }
  Result<std::vector<KeyVersion>> get_history(const std::string& key, std::size_t skip, std::size_t limit) override {
    auto found = stub_.get_history(key, skip, limit);
    if (!found) return found.error();
    std::vector<KeyVersion> out;
    for (auto& entry : *found) out.push_back({std::move(entry.tx_id), entry.timestamp_ns, std::move(entry.value)});
    return out;
  }
  void set_event(const std::string& name, const std::string& payload) override { stub_.set_event(name, payload); }
  const crypto::IdentityName& caller() const override { return caller_.name; }
  bool caller_is_admin() const override { return caller_.admin; }

 private:
  shim::Stub& stub_;
  const Caller caller_;
};

}  // namespace

shim::Response invoke_on_fabric(shim::Stub& stub) {
  auto caller = caller_of(stub.creator());
  if (!caller) return {500, caller.error().message, {}};
  ContractStub contract_stub(stub, std::move(*caller));
  const auto& args = stub.args();
  const std::string function = args.empty() ? "" : args.front();
  const std::vector<std::string> rest(args.begin() + (args.empty() ? 0 : 1), args.end());
  Response response = invoke(contract_stub, function, rest);
  return {response.status, std::move(response.message), std::move(response.payload)};
}

}  // namespace ledgerline::chaincode
