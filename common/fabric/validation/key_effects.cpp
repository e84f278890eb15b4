#include "common/fabric/validation/key_effects.hpp"

#include <cstdint>

#include "common/fabric/validation/channel_state.hpp"

namespace ledgerline::fabric {
namespace {

constexpr std::uint8_t upsert = 1, new_metadata = 2, no_metadata = 4, deletion = 8;

struct KeyChange {
  std::uint8_t flags = 0;  // a sum, as in Fabric
  KeyEffect effect;
};

KeyEffect::Kind kind_of(std::uint8_t flags) {
  if ((flags & deletion) != 0) return KeyEffect::Kind::deletion;
  if ((flags & upsert) != 0 && (flags & (new_metadata | no_metadata)) != 0) return KeyEffect::Kind::value_and_policy;
  return flags == upsert ? KeyEffect::Kind::value : KeyEffect::Kind::policy;
}

}  // namespace

std::map<std::string, KeyEffect> effects_of(const kvrwset::KVRWSet& set) {
  std::map<std::string, KeyChange> said;
  for (const kvrwset::KVWrite& write : set.writes()) {
    KeyChange& one = said[write.key()];
    const bool deletes = write.is_delete() || write.value().empty();
    one.flags = static_cast<std::uint8_t>(one.flags + (deletes ? deletion : upsert));
    if (!deletes) one.effect.value = write.value();
  }
  for (const kvrwset::KVMetadataWrite& write : set.metadata_writes()) {
    KeyChange& one = said[write.key()];
    one.flags = static_cast<std::uint8_t>(one.flags + (write.entries().empty() ? no_metadata : new_metadata));
    if (write.entries().empty()) continue;
    one.effect.policy.clear();
    for (const kvrwset::KVMetadataEntry& entry : write.entries()) {
      if (entry.name() == validation_parameter) one.effect.policy = entry.value();
    }
  }
  std::map<std::string, KeyEffect> effects;
  for (auto& [key, one] : said) {
    one.effect.kind = kind_of(one.flags);
    effects.emplace(key, std::move(one.effect));
  }
  return effects;
}

}  // namespace ledgerline::fabric
