#include "common/dds/settings/config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace ledgerline::dds {
namespace {

std::optional<Security> security(Config& config) {
  Security files;
  const std::pair<Key, std::string*> keys[] = {
      {{"dds.identity_ca",
        "DDS Security: file of the authority's certificate; with the four below, or none of the five"},
       &files.identity_ca},
      {{"dds.certificate", "file of this program's own certificate"}, &files.certificate},
      {{"dds.private_key", "file of its key, mode 0600"}, &files.private_key},
      {{"dds.governance", "file that says what is encrypted, signed by the authority"}, &files.governance},
      {{"dds.permissions", "file that says who may do what, signed by the authority"}, &files.permissions}};
  for (const auto& [key, file] : keys) *file = config.text(key, "");
  const auto is_named = [](const auto& key) { return !key.second->empty(); };
  const auto named = std::find_if(std::begin(keys), std::end(keys), is_named);
  if (named == std::end(keys)) return std::nullopt;
  for (const auto& key : keys) {
    if (!is_named(key)) config.wrong(named->first.name, fmt::format("needs {}, too", key.first.name));
  }
  return files;
}

}  // namespace

ParticipantOptions participant_options(Config& config, const std::string& node) {
  ParticipantOptions options;
  options.local_only =
      config.boolean({"dds.local_only", "true: DDS stays on this machine; false: it may leave it; beats CYCLONEDDS_URI",
                      "true, unless CYCLONEDDS_URI is set"});
  options.cyclonedds = config.text(
      {"dds.cyclonedds", "file of Cyclone DDS's own configuration (XML), which decides; without local_only"}, "");
  if (!options.cyclonedds.empty() && options.local_only) {
    config.wrong("dds.cyclonedds", "must not stand beside dds.local_only: the file says how far DDS reaches");
  }
  options.node = node;
  const auto domain =
      config.integer({"dds.domain", "DDS domain; the range is DDS's own", "ROS_DOMAIN_ID, else 0"}, -1, 0, 232);
  if (domain >= 0) options.domain = static_cast<std::uint32_t>(domain);
  options.security = security(config);
  return options;
}

Result<ParticipantOptions> participant_options_of(const std::string& file, const std::string& node) {
  auto config = file.empty() ? Config::parse("", "") : Config::load(file);
  if (!config) return config.error();
  auto options = participant_options(*config, node);
  if (auto status = config->finish(); !status) return status.error();
  return options;
}

}  // namespace ledgerline::dds
