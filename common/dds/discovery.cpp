#include <dds/dds.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <set>
#include <unordered_map>

#include "common/base/text.hpp"
#include "common/dds/dds.hpp"
#include "common/dds/endpoint.hpp"

namespace ledgerline::dds {
namespace {

constexpr std::size_t max_type_shown = 200;  ///< characters: others choose them

struct DiscoveredEndpoint {
  std::string topic, type;
  Qos qos;
  bool writes = false;
  bool own = false;  ///< of this participant: looked at for clashes alone
};

Qos read_qos(const dds_qos_t* from) {
  Qos qos;
  dds_reliability_kind_t reliability{};
  if (dds_qget_reliability(from, &reliability, nullptr)) qos.reliable = reliability == DDS_RELIABILITY_RELIABLE;
  dds_durability_kind_t durability{};
  if (dds_qget_durability(from, &durability)) qos.transient_local = durability >= DDS_DURABILITY_TRANSIENT_LOCAL;
  dds_history_kind_t history{};
  std::int32_t depth = 0;
  if (dds_qget_history(from, &history, &depth) && history == DDS_HISTORY_KEEP_LAST && depth > 0) qos.depth = depth;
  return qos;
}

/// What both offer, or what satisfies both.
Qos joined(const Qos& a, const Qos& b, bool offered) {
  const auto both = [offered](bool x, bool y) { return offered ? x && y : x || y; };
  return {both(a.reliable, b.reliable), both(a.transient_local, b.transient_local), std::max(a.depth, b.depth)};
}

struct GuidHash {
  std::size_t operator()(const Guid& guid) const {
    return std::hash<std::string_view>()({reinterpret_cast<const char*>(guid.data()), guid.size()});
  }
};

}  // namespace

struct Discovery::State {
  ParticipantPtr participant;
  Guid own{};
  Callback callback;
  std::size_t max_endpoints = 0;

  // DDS has a thread for each of the two topics' readers at times.
  mutable std::mutex mutex;
  std::unordered_map<Guid, DiscoveredEndpoint, GuidHash> endpoints;
  using Name = std::pair<std::string, std::string>;  ///< topic and type
  std::map<Name, DiscoveredTopic> topics;            ///< as they were reported last
  std::uint64_t left_out = 0;

  dds_entity_t writers = 0, readers = 0;

  ~State() {
    // Waits for a running callback.
    if (writers > 0) dds_delete(writers);
    if (readers > 0) dds_delete(readers);
  }

  void read(dds_entity_t reader, bool writes) {
    const std::lock_guard lock(mutex);
    std::set<std::string> touched;
    std::array<void*, 64> samples{};
    std::array<dds_sample_info_t, samples.size()> infos{};
    for (dds_return_t count;
         (count = dds_take(reader, samples.data(), infos.data(), samples.size(), samples.size())) > 0;) {
      for (dds_return_t i = 0; i < count; ++i)
        note(*static_cast<const dds_builtintopic_endpoint_t*>(samples[i]), infos[i], writes, touched);
      (void)dds_return_loan(reader, samples.data(), count);
      samples.fill(nullptr);
    }
    for (const std::string& topic : touched) tell(topic);
  }

  void note(const dds_builtintopic_endpoint_t& endpoint, const dds_sample_info_t& info, bool writes,
            std::set<std::string>& touched) {
    const Guid guid = std::to_array(endpoint.key.v);
    if (info.instance_state != DDS_IST_ALIVE) {
      if (const auto found = endpoints.find(guid); found != endpoints.end()) {
        touched.insert(found->second.topic);
        endpoints.erase(found);
      }
      return;
    }
    if (!info.valid_data || !endpoint.topic_name || !endpoint.type_name) return;
    DiscoveredEndpoint seen{ros_topic(endpoint.topic_name), ros_type(endpoint.type_name), read_qos(endpoint.qos),
                            writes, std::to_array(endpoint.participant_key.v) == own};
    if (seen.topic.empty() || seen.type.empty()) return;
    if (endpoints.size() >= max_endpoints && !endpoints.contains(guid)) {
      ++left_out;
      return;
    }
    touched.insert(seen.topic);
    endpoints[guid] = std::move(seen);
  }

  void tell(const std::string& topic) {
    std::map<std::string, DiscoveredTopic> now;  // by type
    for (const auto& [guid, seen] : endpoints) {
      if (seen.topic != topic) continue;
      DiscoveredTopic& entry = now[seen.type];
      entry.topic = topic;
      entry.type = seen.type;
      if (seen.own) continue;
      const bool first = entry.writers == 0 && (seen.writes || entry.readers == 0);
      if (first)
        entry.qos = seen.qos;
      else if (seen.writes || entry.writers == 0)
        entry.qos = joined(entry.qos, seen.qos, seen.writes);
      ++(seen.writes ? entry.writers : entry.readers);
    }
    for (auto& [type, entry] : now) entry.clash = now.size() > 1;

    // Vanished first, so that a type's end is heard before its successor's begin.
    for (auto known = topics.lower_bound({topic, {}}); known != topics.end() && known->first.first == topic;) {
      const auto found = now.find(known->first.second);
      if (found != now.end() && found->second.writers + found->second.readers > 0) {
        ++known;
        continue;
      }
      callback({topic, known->first.second, {}, 0, 0, false});
      known = topics.erase(known);
    }
    for (const auto& [type, entry] : now) {
      if (entry.writers + entry.readers == 0) continue;
      const auto [known, added] = topics.try_emplace({topic, type});
      if (!added && known->second == entry) continue;
      known->second = entry;
      callback(entry);
    }
  }
};

Result<Discovery> Discovery::create(ParticipantPtr participant, Callback callback, std::size_t max_endpoints) {
  auto state = std::make_shared<State>();
  state->participant = std::move(participant);
  state->own = guid_of(state->participant->handle());
  state->callback = std::move(callback);
  state->max_endpoints = max_endpoints;
  const auto open = [&](dds_entity_t topic, dds_on_data_available_fn changed) {
    dds_listener_t* listener = dds_create_listener(state.get());
    dds_lset_data_available(listener, changed);
    const dds_entity_t reader = dds_create_reader(state->participant->handle(), topic, nullptr, listener);
    dds_delete_listener(listener);
    return reader;
  };
  state->writers = open(DDS_BUILTIN_TOPIC_DCPSPUBLICATION,
                        [](dds_entity_t reader, void* self) { static_cast<State*>(self)->read(reader, true); });
  state->readers = open(DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION,
                        [](dds_entity_t reader, void* self) { static_cast<State*>(self)->read(reader, false); });
  for (const dds_entity_t reader : {state->writers, state->readers}) {
    if (reader < 0) return Error{std::string("DDS does not report its topics: ") + dds_strretcode(reader)};
  }
  // What was there before the listeners were.
  state->read(state->writers, true);
  state->read(state->readers, false);
  return Discovery(std::move(state));
}

std::uint64_t Discovery::left_out() const {
  const std::lock_guard lock(state_->mutex);
  return state_->left_out;
}

std::string why_unheard(const DiscoveredTopic& seen, const ReadTopic& read) {
  if (seen.topic != read.topic || seen.writers == 0) return "";
  if (!read.not_read.empty()) return read.topic + " is written and not read: " + read.not_read;
  if (seen.type != read.type)
    return read.topic + " is written as " + printable(seen.type, max_type_shown) + "; " + read.type + " is read";
  if (read.qos.reliable && !seen.qos.reliable)
    return read.topic + " is written best effort; it is read reliable, and who writes it so is not heard";
  if (read.qos.transient_local && !seen.qos.transient_local)
    return read.topic + " is written volatile; it is read transient local, and who writes it so is not heard";
  return "";
}

namespace {

/// What report_unheard() has reported; changed under Discovery's lock.
class UnheardWriters {
 public:
  UnheardWriters(std::vector<ReadTopic> topics, OnUnheard report)
      : topics_(std::move(topics)),
        report_(std::move(report)),
        types_(topics_.size()),
        left_(topics_.size(), max_unheard_reports) {}

  void update(const DiscoveredTopic& seen) {
    const auto found = std::ranges::find(topics_, seen.topic, &ReadTopic::topic);
    if (found == topics_.end()) return;
    const auto read = static_cast<std::size_t>(found - topics_.begin());
    const std::string why = why_unheard(seen, *found);
    std::set<std::string>& types = types_[read];
    if (why.empty()) {
      if (types.erase(seen.type) > 0 && types.empty()) report_(read, "");
    } else if (types.insert(seen.type).second && left_[read] > 0) {
      --left_[read];
      report_(read, why);
    }
  }

 private:
  std::vector<ReadTopic> topics_;
  OnUnheard report_;
  std::vector<std::set<std::string>> types_;  ///< by topic: those of writers that are not heard
  std::vector<int> left_;                     ///< reports, by topic
};

}  // namespace

Result<Discovery> report_unheard(ParticipantPtr participant, std::vector<ReadTopic> topics, OnUnheard report) {
  return Discovery::create(std::move(participant), [writers = UnheardWriters(std::move(topics), std::move(report))](
                                                       const DiscoveredTopic& seen) mutable { writers.update(seen); });
}

}  // namespace ledgerline::dds
