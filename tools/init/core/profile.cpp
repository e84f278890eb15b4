#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "common/crypto/crypto.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/validation/channel_config.hpp"
#include "tools/init/core/host.hpp"

namespace ledgerline::init {
namespace {

using nlohmann::json;

std::string text(const json& object, const char* key) {
  const auto found = object.is_object() ? object.find(key) : object.end();
  return object.is_object() && found != object.end() && found->is_string() ? found->get<std::string>() : "";
}
json part(const json& object, const char* key) {
  return object.is_object() && object.contains(key) ? object.at(key) : json();
}

/// "grpcs://peer0.org1.example.com:7051" without the scheme. Only TLS is spoken.
Result<std::string> endpoint_of(const std::string& name, const std::string& url) {
  constexpr std::string_view scheme = "grpcs://";
  if (!url.starts_with(scheme) || url.find(':', scheme.size()) == std::string::npos)
    return Error{fmt::format("{}: url is \"{}\", must be grpcs://HOST:PORT", name, url)};
  return url.substr(scheme.size(), url.size() - scheme.size() - (url.ends_with('/') ? 1 : 0));
}

/// Caliper and operators of Kubernetes write a PEM in base64.
std::string pem_of(const std::string& text) {
  constexpr const char* begin = "-----BEGIN";
  if (text.find(begin) != std::string::npos) return text;
  const auto bytes = crypto::unbase64(text);
  return bytes && bytes->find(begin) != std::string::npos ? *bytes : text;
}

/// How test-network and operators write a profile as well: no JSON begins like that.
bool is_yaml(std::string_view text) {
  for (std::string_view line; !text.empty(); text.remove_prefix(std::min(text.size(), line.size() + 1))) {
    line = text.substr(0, text.find('\n'));
    if (line.starts_with("---")) return true;
    const std::size_t end = line.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ-_");
    if (end != 0 && end != std::string_view::npos && line[end] == ':') return true;
    const std::size_t first = line.find_first_not_of(" \t\r");
    if (first != std::string_view::npos && line[first] != '#') return false;
  }
  return false;
}

class Reader {
 public:
  Reader(const json& profile, const Directories& folders, const std::string& profile_folder)
      : profile_(profile), folders_(folders), profile_folder_(profile_folder) {}

  /// Each of them once, so that its authority is one file.
  Result<Server> server(const char* kind, const std::string& name, const std::string& msp_id) {
    const std::pair<std::string, std::string> place(kind, name);
    if (const auto known = servers_.find(place); known != servers_.end()) return known->second;
    auto read = read_server(kind, name, msp_id);
    if (read) servers_.emplace(place, *read);
    return read;
  }
  std::vector<PublicFile> release_files() { return std::move(files_); }

 private:
  Result<Server> read_server(const char* kind, const std::string& name, const std::string& msp_id) {
    const json one = part(part(profile_, kind), name.c_str());
    if (!one.is_object()) return Error{fmt::format("the profile has no {} \"{}\"", kind, name)};
    auto endpoint = endpoint_of(name, text(one, "url"));
    if (!endpoint) return endpoint.error();
    Server out{msp_id, *endpoint, text(part(one, "grpcOptions"), "ssl-target-name-override"), ""};
    if (out.server_name.empty()) out.server_name = text(part(one, "grpcOptions"), "hostnameOverride");
    auto authority = authority_of(one, name);
    if (!authority) return authority.error();
    out.tls_ca = *authority;
    return out;
  }

  Result<std::string> authority_of(const json& one, const std::string& name) {
    if (!folders_.tls_ca.empty()) return folders_.tls_ca;
    const json authorities = part(one, "tlsCACerts");
    if (const std::string path = text(authorities, "path"); !path.empty())
      return (std::filesystem::path(profile_folder_) / path).lexically_normal().string();
    const json pem = part(authorities, "pem");
    std::string content;
    for (const json& certificate : pem.is_array() ? pem : json::array({pem}))
      if (certificate.is_string()) content += pem_of(certificate.get<std::string>());
    if (content.empty()) return Error{fmt::format("{}: tlsCACerts has neither path nor pem", name)};
    if (name.find('/') != std::string::npos) return Error{fmt::format("\"{}\" is no name of a server", name)};
    files_.push_back({folders_.tls_of(name), content});
    return files_.back().path;
  }

  const json& profile_;
  const Directories& folders_;
  const std::string& profile_folder_;
  std::vector<PublicFile> files_;
  std::map<std::pair<std::string, std::string>, Server> servers_;  ///< by kind and name
};

/// The one that is wanted as a bare NAME; else the only one of `channels` that is not wanted for some drones alone, and
/// that is not known to be without the own organisation. A profile without channels leaves it at the plan's.
Result<std::string> first_channel(const json& channels, const HostPlan& plan, const std::vector<std::string>& wanted) {
  std::vector<std::string> named, left;
  std::set<std::string> further;
  for (const std::string& text : wanted) {
    const std::size_t at = text.find('=');
    if (at == std::string::npos) named.push_back(text);
    further.insert(text.substr(0, at));
  }
  if (named.size() > 1)
    return Error{
        fmt::format("--channel {} and --channel {}: one is the first; further ones are NAME=DRONE or "
                    "NAME=DRONE,DRONE",
                    named[0], named[1])};
  if (named.size() == 1) return named[0];
  if (channels.empty()) return plan.channel;
  for (const auto& [name, _] : channels.items()) {
    if (!further.contains(name) && !plan.own_of(name).endpoint.empty()) left.push_back(name);
  }
  if (left.size() == 1) return left[0];
  if (left.empty())
    return Error{fmt::format("the profile lists no peer of {} for a channel that --channel does not give drones to",
                             plan.msp_id)};
  return Error{fmt::format("the profile has the channels {}: --channel NAME says which one is the first",
                           fmt::join(left, ", "))};
}

/// Who of these peers of the own organisation serves each channel that the profile lists peers for, and which one is
/// the first.
Status read_channels(const json& profile, const std::vector<std::string>& own_peers,
                     const std::vector<std::string>& wanted, Reader& reader, HostPlan& plan) {
  json channels = part(profile, "channels");
  if (!channels.is_object()) channels = json::object();
  // What SDKs and operators write for every channel that has no entry of its own.
  const json of_all = part(part(channels, "_default"), "peers");
  channels.erase("_default");
  const auto serves_all = std::find_if(own_peers.begin(), own_peers.end(), [&](const std::string& peer) {
    return of_all.is_object() && of_all.contains(peer);
  });
  if (serves_all != own_peers.end()) {
    auto server = reader.server("peers", *serves_all, plan.msp_id);
    if (!server) return server.error();
    plan.own = std::move(*server);
  }
  for (const auto& [name, channel] : channels.items()) {
    const json listed = part(channel, "peers");
    if (!listed.is_object()) continue;
    const auto first = std::find_if(own_peers.begin(), own_peers.end(),
                                    [&](const std::string& peer) { return listed.contains(peer); });
    Server& serves = plan.own_on[name];
    if (first == own_peers.end()) continue;
    auto server = reader.server("peers", *first, plan.msp_id);
    if (!server) return server.error();
    serves = std::move(*server);
  }
  auto channel = first_channel(channels, plan, wanted);
  if (!channel) return channel.error();
  if (!fabric::is_channel_name(*channel))
    return Error{fmt::format("\"{}\" is no channel's name: a-z first, then a-z, 0-9, . and -", *channel)};
  plan.channel = std::move(*channel);
  if (plan.own_of(plan.channel).endpoint.empty())
    return Error{fmt::format("the profile lists no peer of {} for channel {}", plan.msp_id, plan.channel)};
  return done;
}

/// Adds the block's channel to those that are wanted, as the first one.
Status want_channel_of(const fabric::ChannelConfig& block, std::vector<std::string>& wanted) {
  const auto named = std::find_if(wanted.begin(), wanted.end(),
                                  [](const std::string& text) { return text.find('=') == std::string::npos; });
  if (named == wanted.end())
    wanted.push_back(block.channel);
  else if (*named != block.channel)
    return Error{fmt::format("--channel {}: the config block is of channel {}", *named, block.channel)};
  return done;
}

/// A profile may know its own organisation alone, as each of fabric-samples' test-network does. By name, since a block
/// has them in no order, and a second init must write the same.
Status take_organisations(const fabric::ChannelConfig& block, ProfilePlan& planned) {
  HostPlan& plan = planned.plan;
  plan.msp_ids.clear();
  for (const crypto::MspRoot& organisation : block.organisations) {
    plan.msp_ids.push_back(organisation.msp_id);
    planned.files.push_back({plan.folders.authority_of(organisation.msp_id), organisation.ca_pem});
  }
  std::sort(plan.msp_ids.begin(), plan.msp_ids.end());
  if (std::find(plan.msp_ids.begin(), plan.msp_ids.end(), plan.msp_id) != plan.msp_ids.end()) return done;
  return Error{fmt::format("{} is not on channel {}: its config block has {}", plan.msp_id, block.channel,
                           fmt::join(plan.msp_ids, ", "))};
}

}  // namespace

Result<ProfilePlan> plan_of_profile(std::string_view profile_json, const std::string& msp_id, const std::string& host,
                                    const Directories& folders, std::vector<std::string> channels,
                                    const std::string& profile_folder, const fabric::ChannelConfig* block) {
  const json profile = json::parse(profile_json, nullptr, false);
  if (profile.is_discarded() && is_yaml(profile_json))
    return Error{
        "the profile is YAML, and init reads JSON: convert it, e.g. python3 -c \"import json, sys, yaml; "
        "json.dump(yaml.safe_load(sys.stdin), sys.stdout)\" < profile.yaml > profile.json"};
  if (!profile.is_object()) return Error{"the profile is no JSON object"};
  HostPlan plan{.host = host, .msp_id = msp_id, .ledger = deployment::LedgerKind::fabric, .folders = folders};
  Reader reader(profile, folders, profile_folder);
  std::vector<std::string> own_peers;
  const json organisations = part(profile, "organizations");
  for (const json& organisation : organisations.is_object() ? organisations : json::object()) {
    const std::string id = text(organisation, "mspid");
    if (id.empty()) continue;
    plan.msp_ids.push_back(id);
    const json peers = part(organisation, "peers");
    bool first = true;
    for (const json& peer : peers.is_array() ? peers : json::array()) {
      if (peer.is_string() && id == msp_id) own_peers.push_back(peer.get<std::string>());
      if (!peer.is_string() || !first) continue;
      first = false;
      auto server = reader.server("peers", peer.get<std::string>(), id);
      if (!server) return server.error();
      if (id == msp_id) plan.own = *server;
      plan.peers.push_back(std::move(*server));
    }
  }
  if (plan.own.endpoint.empty()) return Error{fmt::format("the profile has no peer of an organisation {}", msp_id)};
  if (block) {
    if (auto status = want_channel_of(*block, channels); !status) return status.error();
  }
  if (auto status = read_channels(profile, own_peers, channels, reader, plan); !status) return status.error();
  json orderers = part(profile, "orderers");
  if (!orderers.is_object()) orderers = json::object();
  for (const auto& [name, _] : orderers.items()) {
    auto server = reader.server("orderers", name, "");
    if (!server) return server.error();
    plan.orderers.push_back(std::move(*server));
  }
  ProfilePlan planned{std::move(plan), reader.release_files()};
  if (block) {
    planned.batching = block->batching;
    if (auto status = take_organisations(*block, planned); !status) return status.error();
  }
  return planned;
}

}  // namespace ledgerline::init
