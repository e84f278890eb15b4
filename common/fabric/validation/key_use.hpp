#pragma once
#include <algorithm>
#include <cstdint>
#include <map>
#include <string>

#include "common/base/check.hpp"
#include "common/fabric/validation/channel_state.hpp"

namespace ledgerline::fabric {

/// Which of the keys that a bounded memory holds has to go. A client that writes many pushes out its own: the
/// organisation whose transactions brought most keys loses one, of the kind (a key's first segment) of which it has
/// most, and of these the least recently used one. So keys in use stay. Nobody's flood evicts keys of other
/// organisations, nor keys of other kinds of the own one. Pure; one thread.
class KeyUse {
 public:
  KeyUse() = default;
  KeyUse(KeyUse&&) = default;  // places point into it
  KeyUse& operator=(KeyUse&&) = default;

  class Group;
  struct Place {
    Group* group = nullptr;
    std::uint64_t used = 0;
  };
  Place add(const KeyName& name, const std::string& organisation);
  /// It is used now.
  void again(Place& place);
  void remove(const Place& place);
  /// There must be one. Valid until the next change.
  const KeyName& oldest_of_largest() const;

  class Group {
    friend class KeyUse;
    std::string organisation_, kind_;
    std::map<std::uint64_t, KeyName> by_use_;
  };

 private:
  /// Of one organisation apart; the contract has thirteen. Kinds beyond that share one.
  static constexpr std::size_t max_kinds = 16;
  std::map<std::string, std::map<std::string, Group>> groups_;  ///< by organisation and kind; none is empty
  std::uint64_t now_ = 0;
};

inline KeyUse::Place KeyUse::add(const KeyName& name, const std::string& organisation) {
  auto& kinds = groups_[organisation];
  std::string kind = name.key.substr(0, name.key.find('/'));
  if (kinds.size() >= max_kinds && !kinds.contains(kind)) kind.clear();
  Group& group = kinds[kind];
  group.organisation_ = organisation;
  group.kind_ = std::move(kind);
  group.by_use_.emplace_hint(group.by_use_.end(), ++now_, name);
  return {&group, now_};
}

inline void KeyUse::again(Place& place) {
  auto& by_use = place.group->by_use_;
  auto node = by_use.extract(place.used);  // no allocation: each state and command comes by here
  node.key() = place.used = ++now_;
  by_use.insert(by_use.end(), std::move(node));
}

inline void KeyUse::remove(const Place& place) {
  Group& group = *place.group;
  group.by_use_.erase(place.used);
  if (!group.by_use_.empty()) return;
  const auto kinds = groups_.find(group.organisation_);
  kinds->second.erase(std::string(group.kind_));
  if (kinds->second.empty()) groups_.erase(kinds);
}

inline const KeyName& KeyUse::oldest_of_largest() const {
  LEDGERLINE_CHECK(!groups_.empty(), "a key is looked for to make room, so there is one");
  const auto keys_of = [](const auto& organisation) {
    std::size_t keys = 0;
    for (const auto& [kind, group] : organisation.second) keys += group.by_use_.size();
    return keys;
  };
  const auto most = std::ranges::max_element(groups_, {}, keys_of);
  const auto& largest =
      std::ranges::max_element(most->second, {}, [](const auto& kind) { return kind.second.by_use_.size(); })->second;
  return largest.by_use_.begin()->second;
}

}  // namespace ledgerline::fabric
