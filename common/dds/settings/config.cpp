#include "common/dds/settings/config.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace ledgerline::dds {
namespace {

std::optional<Security> security(Config& config) {
  Security files;
  const std::pair<const char*, std::string*> keys[] = {{"dds.identity_ca", &files.identity_ca},
                                                       {"dds.certificate", &files.certificate},
                                                       {"dds.private_key", &files.private_key},
                                                       {"dds.governance", &files.governance},
                                                       {"dds.permissions", &files.permissions}};
  for (const auto& [key, file] : keys) *file = config.text(key, "");
  const auto is_named = [](const auto& key) { return !key.second->empty(); };
  const auto named = std::find_if(std::begin(keys), std::end(keys), is_named);
  if (named == std::end(keys)) return std::nullopt;
  for (const auto& key : keys) {
    if (!is_named(key)) config.wrong(named->first, fmt::format("needs {}, too", key.first));
  }
  return files;
}

}  // namespace

ParticipantOptions participant_options(Config& config, const std::string& node) {
  ParticipantOptions options;
  options.local_only = config.boolean("dds.local_only");
  options.cyclonedds = config.text("dds.cyclonedds", "");
  if (!options.cyclonedds.empty() && options.local_only) {
    config.wrong("dds.cyclonedds", "must not stand beside dds.local_only: the file says how far DDS reaches");
  }
  options.node = node;
  const auto domain = config.integer("dds.domain", -1, 0, 232);
  if (domain >= 0) options.domain = static_cast<std::uint32_t>(domain);
  options.security = security(config);
  return options;
}

}  // namespace ledgerline::dds
