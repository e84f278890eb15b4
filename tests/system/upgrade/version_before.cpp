#include <cstdio>
#include <nlohmann/json.hpp>

#include "chaincode/contract/contract_common.hpp"
#include "chaincode/service/contract_stub.hpp"
#include "common/msg/contract.hpp"
#include "common/program/program.hpp"
#include "ledgerline.pb.h"

/// The contract as it was one version ago, as a chaincode service: today's functions over a ledger that keeps its
/// records as commit e8a58b8 did, the last one before records had versions and keys had policies. Of what it wrote it
/// stands for:
///
/// - Stored.version is not there, and no key has a policy.
/// - A lease is lease/<holder>/<epoch>, and a commander's newest call command/<holder>; no pilot/<owner MSP>/<holder>.
///   (Both held the drones of all organisations. Here they hold one's, so a channel must have drones of one.)
/// - A role is role/<identity>, of one identity alone.
/// - An anchor is anchor/<digest>/<identity>.
/// - enroll writes neither empty grants nor requests, nor a host's empty frame.
/// - clear_stop, which was called resume, writes the stop itself again, as cleared. (apply_stops was called fold. Both
///   have today's names here, since today's programs call them.)
///
/// What it refused and answered is today's, but that `command` took calls without an organisation: who sends those is
/// not there to be tested.
namespace {

using namespace ledgerline;
using chaincode::first_segment;

std::vector<std::string> segments_of(const std::string& key) {
  std::vector<std::string> segments{""};
  for (const char c : key) {
    if (c == '/') {
      segments.emplace_back();
    } else {
      segments.back() += c;
    }
  }
  return segments;
}

/// Without the owner's MSP id, where today's has it.
std::string key_before(const std::string& key) {
  auto segments = segments_of(key);
  const bool lease = segments[0] == "lease" && segments.size() == 4;
  const bool command = segments[0] == "command" && segments.size() == 3;
  const bool anchor = segments[0] == "anchor" && segments.size() == 4;
  if (!lease && !command && !anchor) return key;
  segments.erase(segments.begin() + (anchor ? 2 : 1));
  std::string before = segments[0];
  for (std::size_t i = 1; i < segments.size(); ++i) before += "/" + segments[i];
  return before;
}

bool is_role_table(const std::string& key) {
  const auto segments = segments_of(key);
  return segments[0] == "role" && segments.size() == 3;
}

class VersionBefore final : public shim::Stub {
 public:
  explicit VersionBefore(shim::Stub& stub) : stub_(stub) {}

  const std::string& channel() const override { return stub_.channel(); }
  const std::string& tx_id() const override { return stub_.tx_id(); }
  const std::string& creator() const override { return stub_.creator(); }
  const std::vector<std::string>& args() const override { return stub_.args(); }

  /// Says that each record is of today's version, so that nothing is renewed.
  Result<std::optional<std::string>> get_state(const std::string& key) override {
    Stored stored;
    stored.set_version(contract::record_version);
    if (first_segment(key) == "pilot") return std::optional(stored.SerializeAsString());
    if (is_role_table(key)) return std::optional<std::string>{};  // so the contract looks for the identity's own record
    auto value = stub_.get_state(key_before(key));
    if (!value || !*value || !stored.ParseFromString(**value)) return value;
    stored.set_version(contract::record_version);
    return std::optional(stored.SerializeAsString());
  }

  Status put_state(const std::string& key, const std::string& value) override {
    const std::string kind = first_segment(key);
    if (kind == "pilot") return done;
    Stored stored;
    if (!stored.ParseFromString(value)) return Error{"the value of " + key + " is damaged"};
    if (kind == "frame" && stored.assets().empty()) return done;
    stored.clear_version();
    if (is_role_table(key)) return put_roles(key, stored);
    if (kind == "stop") return put_stop(key, std::move(stored));
    if ((kind == "grant" || kind == "request") && stored.assets(0).msg_data().empty()) {
      const auto known = stub_.get_state(key);
      if (!known || !*known) return known ? Status(done) : known.error();
    }
    return put(key_before(key), std::move(stored));
  }

  Status del_state(const std::string& key) override { return stub_.del_state(key_before(key)); }
  Status set_state_validation_parameter(const std::string&, const std::string&) override { return done; }
  Result<std::vector<shim::KeyValue>> get_range(const std::string& start, const std::string& end,
                                                std::size_t limit) override {
    return stub_.get_range(start, end, limit);
  }
  Result<std::vector<shim::KeyModification>> get_history(const std::string& key, std::size_t skip,
                                                         std::size_t limit) override {
    return stub_.get_history(key_before(key), skip, limit);
  }
  void set_event(const std::string& name, const std::string& payload) override { stub_.set_event(name, payload); }

 private:
  /// Under this key, by which a record calls itself, too.
  Status put(const std::string& key, Stored stored) {
    const bool record = kept_under_its_own_key(key);
    if (record && stored.assets_size() == 1) {
      stored.mutable_assets(0)->set_id(key);
      stored.mutable_assets(0)->set_topic("/" + key);
    }
    return stub_.put_state(key, stored.SerializeAsString());
  }
  static bool kept_under_its_own_key(const std::string& key) {
    const std::string kind = first_segment(key);
    return kind != "asset" && kind != "frame";
  }

  /// role/<identity> of each in the table.
  Status put_roles(const std::string& key, const Stored& table_record) {
    RoleTable table;
    if (!table.ParseFromString(table_record.assets(0).msg_data())) return Error{key + " is damaged"};
    for (const RoleTable::Entry& entry : table.entries()) {
      EnrollCall role;
      role.mutable_identity()->set_msp_id(segments_of(key)[1]);
      role.mutable_identity()->set_subject(entry.subject());
      role.set_role(entry.role());
      Stored stored = table_record;
      stored.mutable_assets(0)->set_msg_type("ledgerline.EnrollCall");
      stored.mutable_assets(0)->set_msg_data(role.SerializeAsString());
      const std::string own = chaincode::role_key_before(to_name(role.identity()));
      if (Status status = put(own, std::move(stored)); !status) return status;
    }
    return done;
  }

  /// stop/<drone>/<stopper> with the fields that it had; a record below it that says that it is cleared makes it
  /// cleared.
  Status put_stop(const std::string& key, Stored stored) {
    constexpr std::size_t stop_segments = 3;
    auto segments = segments_of(key);
    const bool clears = segments.size() > stop_segments;
    const std::string of = segments[0] + "/" + segments[1] + "/" + segments[2];
    if (clears) {
      const auto before = stub_.get_state(of);
      if (!before) return before.error();
      if (!*before || !stored.ParseFromString(**before)) return Error{"there is no " + of + " to clear"};
    }
    Stop now, then;
    if (stored.assets_size() != 1 || !now.ParseFromString(stored.assets(0).msg_data()))
      return Error{key + " is damaged"};
    then.set_drone(now.drone());
    *then.mutable_stopper() = now.stopper();
    then.set_cut(now.cut());
    then.set_cleared(clears || now.cleared());
    stored.mutable_assets(0)->set_msg_data(then.SerializeAsString());
    return put(of, std::move(stored));
  }

  shim::Stub& stub_;
};

}  // namespace

int main() {
  const sigset_t signals = block_signals();
  const auto options = shim::options_from_environment();
  if (!options) return fail(options.error(), exit_usage);
  const auto server = shim::Server::start(*options, [](shim::Stub& stub) {
    VersionBefore before(stub);
    return chaincode::invoke_on_fabric(before);
  });
  if (!server) return fail(server.error());
  print_line(nlohmann::json{{"ready", true}, {"endpoint", (*server)->endpoint()}}.dump());
  int signal = 0;
  sigwait(&signals, &signal);
  (*server)->stop();
}
