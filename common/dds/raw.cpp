#include "common/dds/raw.hpp"

#include "common/dds/dds.hpp"
#include "common/dds/endpoint.hpp"

namespace ledgerline::dds {
namespace {

struct Names {
  std::string topic, type;
};
Result<Names> dds_names(const std::string& ros_topic, const std::string& ros_type) {
  const auto topic = dds_topic(ros_topic);
  if (!topic) return topic.error();
  const auto type = dds_type(ros_type);
  if (!type) return type.error();
  return Names{*topic, *type};
}

/// A reader or writer that is one of our node's as long as it lives.
struct NodeEndpoint {
  ParticipantPtr participant;
  Endpoint endpoint;

  Status announce(Status (NodeInfo::*add)(dds_entity_t)) {
    NodeInfo* const node = participant->node();
    return node ? (node->*add)(endpoint.handle()) : Status(done);
  }
  ~NodeEndpoint() {
    if (NodeInfo* node = participant->node()) node->remove(endpoint.handle());
  }
};

}  // namespace

struct RawWriter::State : NodeEndpoint {};

Result<RawWriter> RawWriter::create(ParticipantPtr participant, const std::string& ros_topic,
                                    const std::string& ros_type, const Qos& qos) {
  const auto names = dds_names(ros_topic, ros_type);
  if (!names) return names.error();
  auto state = std::make_shared<State>();
  state->participant = std::move(participant);
  Status opened = state->endpoint.open_writer(state->participant->handle(), names->topic, names->type, qos);
  if (opened) opened = state->announce(&NodeInfo::add_writer);
  if (!opened) return opened.error();
  return RawWriter(std::move(state));
}

Status RawWriter::publish(std::span<const std::uint8_t> cdr, TimeNs source_time_ns) {
  return state_->endpoint.write(cdr, source_time_ns);
}

Status RawWriter::publish(std::string_view cdr) {
  return publish(std::span(reinterpret_cast<const std::uint8_t*>(cdr.data()), cdr.size()));
}

int RawWriter::readers() const {
  dds_publication_matched_status_t status{};
  if (dds_get_publication_matched_status(state_->endpoint.handle(), &status) < 0) return 0;
  return static_cast<int>(status.current_count);
}

Refused RawWriter::refused() const { return state_->endpoint.refused(); }

struct RawReader::State {
  Callback callback;
  /// GUIDs of the writers heard last, by DDS's local handles, which are not used again. For the callback's thread
  /// alone.
  std::array<std::pair<dds_instance_handle_t, Guid>, 16> writers{};
  std::size_t next_writer = 0;
  NodeEndpoint own;  ///< ends first: then no callback runs

  const Guid& writer(dds_entity_t reader, dds_instance_handle_t handle) {
    for (const auto& [known, guid] : writers) {
      if (known == handle) return guid;
    }
    auto& entry = writers[next_writer++ % writers.size()];
    entry = {handle, {}};
    if (dds_builtintopic_endpoint_t* found = dds_get_matched_publication_data(reader, handle)) {
      entry.second = std::to_array(found->key.v);
      dds_builtintopic_free_endpoint(found);
    }
    return entry.second;
  }

  static void data_available(dds_entity_t reader, void* argument) {
    auto& self = *static_cast<State*>(argument);
    std::array<ddsi_serdata*, 16> messages{};
    std::array<dds_sample_info_t, messages.size()> infos{};
    dds_return_t count = messages.size();
    while (count == static_cast<dds_return_t>(messages.size())) {
      count = dds_takecdr(reader, messages.data(), messages.size(), infos.data(), DDS_ANY_STATE);
      for (dds_return_t i = 0; i < count; ++i) {
        if (infos[i].valid_data && !bytes_of(messages[i]).empty())
          self.callback(bytes_of(messages[i]),
                        {infos[i].source_timestamp, self.writer(reader, infos[i].publication_handle)});
        ddsi_serdata_unref(messages[i]);
      }
    }
  }
};

Result<RawReader> RawReader::create(ParticipantPtr participant, const std::string& ros_topic,
                                    const std::string& ros_type, const Qos& qos, Callback callback) {
  const auto names = dds_names(ros_topic, ros_type);
  if (!names) return names.error();
  auto state = std::make_shared<State>();
  state->callback = std::move(callback);
  NodeEndpoint& own = state->own;
  own.participant = std::move(participant);
  Status opened = own.endpoint.open_reader(own.participant->handle(), names->topic, names->type, qos,
                                           &State::data_available, state.get());
  if (opened) opened = own.announce(&NodeInfo::add_reader);
  if (!opened) return opened.error();
  return RawReader(std::move(state));
}

int RawReader::writers() const {
  dds_subscription_matched_status_t status{};
  if (dds_get_subscription_matched_status(state_->own.endpoint.handle(), &status) < 0) return 0;
  return static_cast<int>(status.current_count);
}

Refused RawReader::refused() const { return state_->own.endpoint.refused(); }

std::uint64_t RawReader::lost() const {
  dds_sample_lost_status_t status{};
  if (dds_get_sample_lost_status(state_->own.endpoint.handle(), &status) < 0) return 0;
  return status.total_count;
}

}  // namespace ledgerline::dds
