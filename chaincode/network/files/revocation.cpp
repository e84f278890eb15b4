#include "chaincode/network/files/authority.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <random>
#include <thread>

#include "chaincode/network/options.hpp"
#include "chaincode/network/processes/processes.hpp"
#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/configtx.pb.h"
#include "common/crypto/crypto.hpp"
#include "common/rt/retry.hpp"
#include "msp/msp_config.pb.h"

namespace ledgerline::network {
namespace {

namespace fs = std::filesystem;

constexpr TimeNs timeout_ns = 20 * ns_per_s;
constexpr const char *application = "Application", *msp_value = "MSP";

/// An organisation's MSP in a channel's configuration, with what an update must repeat of it.
struct Found {
  std::string channel;
  std::uint64_t root_version = 0, application_version = 0, organisation_version = 0;
  common::ConfigValue value;
  msp::MSPConfig envelope;
  msp::FabricMSPConfig msp;
};

Result<Found> find_msp(std::string_view config_block, const std::string& msp_id) {
  common::Block block;
  common::Envelope envelope;
  common::Payload payload;
  common::ChannelHeader header;
  common::ConfigEnvelope config;
  if (!block.ParseFromArray(config_block.data(), static_cast<int>(config_block.size())) ||
      block.data().data_size() != 1 || !envelope.ParseFromString(block.data().data(0)) ||
      !payload.ParseFromString(envelope.payload()) || !header.ParseFromString(payload.header().channel_header()) ||
      header.type() != common::CONFIG || !config.ParseFromString(payload.data())) {
    return Error{"not a block with a channel's configuration"};
  }
  const common::ConfigGroup& root = config.config().channel_group();
  const auto applications = root.groups().find(application);
  if (applications == root.groups().end()) return Error{header.channel_id() + " has no applications' organisations"};
  const auto organisation = applications->second.groups().find(msp_id);
  if (organisation == applications->second.groups().end()) {
    return Error{fmt::format("{} is no organisation of channel {}", msp_id, header.channel_id())};
  }
  const auto value = organisation->second.values().find(msp_value);
  Found found;
  if (value == organisation->second.values().end() || !found.envelope.ParseFromString(value->second.value()) ||
      !found.msp.ParseFromString(found.envelope.config())) {
    return Error{fmt::format("channel {} has no readable MSP of {}", header.channel_id(), msp_id)};
  }
  found.channel = header.channel_id();
  found.root_version = root.version();
  found.application_version = applications->second.version();
  found.organisation_version = organisation->second.version();
  found.value = value->second;
  return found;
}

/// The way down to an organisation, each step with the version that it has and keeps.
common::ConfigGroup* way_to(common::ConfigGroup& root, const Found& found, const std::string& msp_id) {
  root.set_version(found.root_version);
  common::ConfigGroup& applications = (*root.mutable_groups())[application];
  applications.set_version(found.application_version);
  common::ConfigGroup& organisation = (*applications.mutable_groups())[msp_id];
  organisation.set_version(found.organisation_version);
  return &organisation;
}

bool lists(const msp::FabricMSPConfig& msp, const std::string& list) {
  const auto& all = msp.revocation_list();
  return std::find(all.begin(), all.end(), list) != all.end();
}

/// An error: `old` is of the same authority, and newer.
Result<bool> takes_the_place_of(const crypto::ListOrigin& made, const std::string& old) {
  const auto origin = crypto::origin_of_list(old);
  if (!origin || !crypto::is_of_same_authority(made, *origin)) return false;
  if (crypto::is_older(made, *origin))
    return Error{
        "the revocation list is older than the authority's list that is in force: an identity that was revoked since "
        "would be a member again. Ask the authority for its newest list"};
  return true;
}

/// The newest list of an authority holds all that it revoked; what the organisation's other authorities have revoked
/// stays.
Status replace_list(msp::FabricMSPConfig& msp, const std::string& list) {
  const auto made = crypto::origin_of_list(list);
  if (!made) return made.error();
  std::vector<std::string> kept;
  for (const std::string& old : msp.revocation_list()) {
    const auto replaced = takes_the_place_of(*made, old);
    if (!replaced) return replaced.error();
    if (!*replaced) kept.push_back(old);
  }
  msp.clear_revocation_list();
  for (std::string& old : kept) msp.add_revocation_list(std::move(old));
  msp.add_revocation_list(list);
  return done;
}

/// A channel of a running network.
struct Where {
  const Options& options;
  const ListenAddresses& addresses;
  std::string channel;
};

/// The channel's configuration as an orderer has it, or where none is named the organisation's peer.
Result<std::string> fetch_config(const Where& where, int organisation, const std::vector<std::string>& orderer) {
  const Options& options = where.options;
  const std::string file = fmt::format("{}/config.{}.block", options.dir, ::getpid());
  Command command{"fetching the configuration of channel " + where.channel,
                  {options.tools + "/peer", "channel", "fetch", "config", file, "-c", where.channel},
                  admin_environment(options, where.addresses, organisation)};
  command.words.insert(command.words.end(), orderer.begin(), orderer.end());
  const auto ran = run_command(command, options.dir + "/logs/revocation.log");
  auto block = read_file(file);
  std::error_code error;
  fs::remove(file, error);
  if (!ran) return ran.error();
  return block;
}

/// For the MSPs that programs read from files when they start. That organisation has one authority.
Status write_lists(const Options& options, int organisation, const std::string& list) {
  const auto made = crypto::origin_of_list(list);
  if (!made) return made.error();
  const auto old = read_file(identities::organisation_dir(options.dir, organisation) / "msp" / "crls" / "crl.pem");
  if (old) {
    if (const auto replaced = takes_the_place_of(*made, *old); !replaced) return replaced.error();
  }
  for (const fs::path& msp : {identities::organisation_dir(options.dir, organisation) / "msp",
                              identities::peer_dir(options.dir, organisation) / "msp"}) {
    if (Status s = write_file(msp / "crls" / "crl.pem", list); !s) return s;
  }
  return done;
}

/// Tries until it succeeds; after so long, its last error.
template <typename Try>
Status try_for_a_while(const Try& attempt) {
  BackOff waits(50 * ns_per_ms, 1 * ns_per_s);
  Random random(std::random_device{}());
  for (const TimeNs until = monotonic_ns() + timeout_ns;;) {
    const Status status = attempt();
    if (status || monotonic_ns() > until) return status;
    std::this_thread::sleep_for(std::chrono::nanoseconds(waits.next(random)));
  }
}

/// One attempt through one orderer; done too when the list is there already.
Status update_channel(const Where& where, int organisation, int number, const std::string& list) {
  const Options& options = where.options;
  const std::vector<std::string> orderer{"-o", where.addresses.orderer(number), "--tls", "--cafile",
                                         identities::orderer_dir(options.dir, number) / "tls" / "ca.crt"};
  const std::string msp_id = identities::msp_id_of(organisation);
  const auto block = fetch_config(where, organisation, orderer);
  if (!block) return block.error();
  const auto there = has_revocation_list(*block, msp_id, list);
  if (!there) return there.error();
  if (*there) return done;
  const auto update = revocation_update(*block, msp_id, list);
  if (!update) return update.error();
  const std::string file = fmt::format("{}/update.{}.tx", options.dir, ::getpid());
  if (Status s = write_file(file, *update); !s) return s;
  Command command{"updating the configuration of channel " + where.channel,
                  {options.tools + "/peer", "channel", "update", "-f", file, "-c", where.channel},
                  admin_environment(options, where.addresses, organisation)};
  command.words.insert(command.words.end(), orderer.begin(), orderer.end());
  const auto updated = run_command(command, options.dir + "/logs/revocation.log");
  std::error_code error;
  fs::remove(file, error);
  if (!updated) return updated.error();
  return done;
}

constexpr const char* admin_signs = "Admin cannot be revoked: it signs for its organisation, and there is one alone";

/// A certificate of a network with fabric-ca.
Status check_revocable(const Options& options, int organisation, const std::string& pem) {
  const auto certificate = crypto::parse_certificate(pem);
  if (!certificate) return certificate.error();
  constexpr std::array roles{"client", "peer", "admin"};
  if (std::none_of(certificate->units.begin(), certificate->units.end(),
                   [&](const std::string& unit) { return std::find(roles.begin(), roles.end(), unit) != roles.end(); }))
    return Error{
        fmt::format("{} is no member's certificate (OU=client, peer or admin): Fabric looks up no other one, such "
                    "as those of TLS, in a revocation list",
                    printable(certificate->subject))};
  const auto admins = crypto::identity_files(identities::user_dir(options.dir, organisation, "Admin") / "msp");
  if (!admins) return admins.error();
  const auto in_use = crypto::read_certificate_file(admins->certificate);
  if (!in_use) return in_use.error();
  const auto own = crypto::certificate_hash(pem), its = crypto::certificate_hash(*in_use);
  if (own && its && *own == *its) return Error{admin_signs};
  return done;
}

Status check_known(const Where& where, int organisation, const std::string& msp_id, const std::string& list) {
  const auto block = fetch_config(where, organisation, {});
  if (!block) return block.error();
  const auto known = has_revocation_list(*block, msp_id, list);
  if (!known) return known.error();
  if (!*known)
    return Error{fmt::format("peer {} does not know the revocation list on channel {}", organisation, where.channel)};
  return done;
}

}  // namespace

Result<bool> has_revocation_list(std::string_view config_block, const std::string& msp_id, const std::string& list) {
  const auto found = find_msp(config_block, msp_id);
  if (!found) return found.error();
  return lists(found->msp, list);
}

Result<std::string> revocation_update(std::string_view config_block, const std::string& msp_id,
                                      const std::string& list) {
  auto found = find_msp(config_block, msp_id);
  if (!found) return found.error();
  if (Status replaced = replace_list(found->msp, list); !replaced) return replaced.error();
  found->envelope.set_config(found->msp.SerializeAsString());
  found->value.set_value(found->envelope.SerializeAsString());
  found->value.set_version(found->value.version() + 1);

  common::ConfigUpdate update;
  update.set_channel_id(found->channel);
  way_to(*update.mutable_read_set(), *found, msp_id);
  (*way_to(*update.mutable_write_set(), *found, msp_id)->mutable_values())[msp_value] = found->value;
  common::ConfigUpdateEnvelope unsigned_update;
  unsigned_update.set_config_update(update.SerializeAsString());
  common::ChannelHeader header;
  header.set_type(common::CONFIG_UPDATE);
  header.set_channel_id(found->channel);
  common::Payload payload;
  payload.mutable_header()->set_channel_header(header.SerializeAsString());
  payload.set_data(unsigned_update.SerializeAsString());
  common::Envelope envelope;
  envelope.set_payload(payload.SerializeAsString());
  return envelope.SerializeAsString();
}

Result<std::string> read_list(const Options& options, int organisation, const std::string& file) {
  const std::string ca_file = identities::organisation_dir(options.dir, organisation) / "ca" /
                              fmt::format("ca.{}-cert.pem", identities::domain_of(organisation));
  auto list = read_file(file);
  const auto ca = read_file(ca_file);
  if (!list) return list.error();
  if (!ca) return ca.error();
  // Fabric ignores a list that no authority of the organisation has signed, and says nothing.
  const auto lists = crypto::read_revocation_lists(*list, {{identities::msp_id_of(organisation), *ca}});
  if (!lists) return Error{file + ": " + lists.error().message};
  if (lists->size() > 1) return Error{file + ": it holds several lists, of which Fabric would read the first alone"};
  // With such a list in the configuration peers and orderers refuse everybody of the organisation, its administrator
  // too.
  if (!crypto::lists_name_key(*list))
    return Error{file + ": a list has no authority key identifier: Fabric would refuse the whole organisation"};
  return list;
}

Status revoke(const Options& options, const ListenAddresses& addresses, int organisation, const Revoked& revoked) {
  if (revoked.user == "Admin") return Error{admin_signs};
  if (!has_authorities(options.dir)) return Error{options.dir + " has no fabric-ca: it was not begun with --ca"};
  if (revoked.user.empty()) {
    if (Status s = check_revocable(options, organisation, revoked.certificate_pem); !s) return s;
  }
  const auto list = revoke_at_authority(authorities(options, addresses), organisation, revoked);
  if (!list) return list.error();
  return publish_list(options, addresses, organisation, *list);
}

Status publish_list(const Options& options, const ListenAddresses& addresses, int organisation,
                    const std::string& list) {
  if (Status s = write_lists(options, organisation, list); !s) return s;
  const int orderers = static_cast<int>(addresses.orderers.size());
  for (const std::string& channel : options.channels) {
    const Where where{options, addresses, channel};
    int tried = 0;  // an orderer may just have started, or be gone: the next one
    const Status updated =
        try_for_a_while([&] { return update_channel(where, organisation, tried++ % orderers + 1, list); });
    if (!updated) return updated;
    for (int k = 1; k <= identities::organisations; ++k) {
      const Status known =
          try_for_a_while([&] { return check_known(where, k, identities::msp_id_of(organisation), list); });
      if (!known) return known;
    }
  }
  return done;
}

}  // namespace ledgerline::network
