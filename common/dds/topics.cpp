#include <dds/dds.h>

#include <array>
#include <cstring>
#include <string>
#include <type_traits>

#include "common/dds/dds.hpp"
#include "ros_types.h"

namespace ledgerline::dds {
namespace {

using TimeWire = builtin_interfaces_msg_dds__Time_;
using HeaderWire = std_msgs_msg_dds__Header_;
using PoseWire = geometry_msgs_msg_dds__Pose_;
using TwistWire = geometry_msgs_msg_dds__Twist_;

HeaderWire to_wire(const Header& header) {
  TimeNs seconds = header.stamp_ns / ns_per_s;
  TimeNs rest = header.stamp_ns % ns_per_s;
  if (rest < 0) {
    rest += ns_per_s;
    --seconds;
  }
  HeaderWire wire{};
  wire.stamp = {static_cast<std::int32_t>(seconds), static_cast<std::uint32_t>(rest)};
  wire.frame_id = const_cast<char*>(header.frame_id.c_str());  // DDS only reads it
  return wire;
}

Header from_wire(const HeaderWire& wire) {
  return {wire.stamp.sec * ns_per_s + static_cast<TimeNs>(wire.stamp.nanosec), wire.frame_id ? wire.frame_id : ""};
}

PoseWire pose_to_wire(const std::array<double, 3>& p, const std::array<double, 4>& q) {
  return {{p[0], p[1], p[2]}, {q[0], q[1], q[2], q[3]}};
}

TwistWire twist_to_wire(const std::array<double, 3>& linear, const std::array<double, 3>& angular) {
  return {{linear[0], linear[1], linear[2]}, {angular[0], angular[1], angular[2]}};
}

void pose_from_wire(const PoseWire& wire, std::array<double, 3>& p, std::array<double, 4>& q) {
  p = {wire.position.x, wire.position.y, wire.position.z};
  q = {wire.orientation.x, wire.orientation.y, wire.orientation.z, wire.orientation.w};
}

void twist_from_wire(const TwistWire& wire, std::array<double, 3>& linear, std::array<double, 3>& angular) {
  linear = {wire.linear.x, wire.linear.y, wire.linear.z};
  angular = {wire.angular.x, wire.angular.y, wire.angular.z};
}

/// What a message is in DDS. The wire form borrows the message's strings.
template <typename Message>
struct Traits;

template <>
struct Traits<PoseStamped> {
  using Wire = geometry_msgs_msg_dds__PoseStamped_;
  static const dds_topic_descriptor_t& descriptor() { return geometry_msgs_msg_dds__PoseStamped__desc; }
  static Wire to(const PoseStamped& m) { return {to_wire(m.header), pose_to_wire(m.position_m, m.orientation)}; }
  static PoseStamped from(const Wire& wire) {
    PoseStamped m;
    m.header = from_wire(wire.header);
    pose_from_wire(wire.pose, m.position_m, m.orientation);
    return m;
  }
};

template <>
struct Traits<Twist> {
  using Wire = TwistWire;
  static const dds_topic_descriptor_t& descriptor() { return geometry_msgs_msg_dds__Twist__desc; }
  static Wire to(const Twist& m) { return twist_to_wire(m.linear_mps, m.angular_radps); }
  static Twist from(const Wire& wire) {
    Twist m;
    twist_from_wire(wire, m.linear_mps, m.angular_radps);
    return m;
  }
};

template <>
struct Traits<Odometry> {
  using Wire = nav_msgs_msg_dds__Odometry_;
  static const dds_topic_descriptor_t& descriptor() { return nav_msgs_msg_dds__Odometry__desc; }
  static Wire to(const Odometry& m) {
    Wire wire{};
    wire.header = to_wire(m.header);
    wire.child_frame_id = const_cast<char*>(m.child_frame_id.c_str());  // DDS only reads it
    wire.pose.pose = pose_to_wire(m.position_m, m.orientation);
    wire.twist.twist = twist_to_wire(m.linear_mps, m.angular_radps);
    return wire;
  }
  static Odometry from(const Wire& wire) {
    Odometry m;
    m.header = from_wire(wire.header);
    m.child_frame_id = wire.child_frame_id ? wire.child_frame_id : "";
    pose_from_wire(wire.pose.pose, m.position_m, m.orientation);
    twist_from_wire(wire.twist.twist, m.linear_mps, m.angular_radps);
    return m;
  }
};

constexpr std::int32_t history_depth = 10;  // ROS 2's default

struct QosDelete {
  void operator()(dds_qos_t* qos) const { dds_delete_qos(qos); }
};
struct ListenerDelete {
  void operator()(dds_listener_t* listener) const { dds_delete_listener(listener); }
};
using Qos = std::unique_ptr<dds_qos_t, QosDelete>;

Qos make_qos(dds_reliability_kind_t reliability) {
  Qos qos(dds_create_qos());
  dds_qset_reliability(qos.get(), reliability, DDS_MSECS(100));
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, history_depth);
  dds_qset_durability(qos.get(), DDS_DURABILITY_VOLATILE);
  return qos;
}

/// An entity and what it stands on; deleted before them.
struct Entity {
  ParticipantPtr participant;
  dds_entity_t topic = 0;
  dds_entity_t handle = 0;

  Entity() = default;
  Entity(const Entity&) = delete;
  Entity& operator=(const Entity&) = delete;
  ~Entity() {
    // Waits for a running callback.
    if (handle > 0) dds_delete(handle);
    if (topic > 0) dds_delete(topic);
  }
};

template <typename Message>
Status open_topic(Entity& entity, ParticipantPtr participant, const std::string& ros_topic) {
  auto name = dds_topic(ros_topic);
  if (!name) return name.error();
  entity.participant = std::move(participant);
  entity.topic =
      dds_create_topic(entity.participant->handle(), &Traits<Message>::descriptor(), name->c_str(), nullptr, nullptr);
  if (entity.topic < 0) return Error{"DDS topic " + ros_topic + ": " + dds_strretcode(entity.topic)};
  return done;
}

}  // namespace

template <typename Message>
struct Publisher<Message>::State : Entity {};

template <typename Message>
Publisher<Message>::Publisher(std::unique_ptr<State> state) : state_(std::move(state)) {}
template <typename Message>
Publisher<Message>::Publisher(Publisher&&) noexcept = default;
template <typename Message>
Publisher<Message>& Publisher<Message>::operator=(Publisher&&) noexcept = default;
template <typename Message>
Publisher<Message>::~Publisher() = default;

template <typename Message>
Result<Publisher<Message>> Publisher<Message>::create(ParticipantPtr participant, const std::string& topic) {
  auto state = std::make_unique<State>();
  if (auto opened = open_topic<Message>(*state, std::move(participant), topic); !opened) return opened.error();
  const Qos qos = make_qos(DDS_RELIABILITY_RELIABLE);
  state->handle = dds_create_writer(state->participant->handle(), state->topic, qos.get(), nullptr);
  if (state->handle < 0) return Error{"DDS writer of " + topic + ": " + dds_strretcode(state->handle)};
  return Publisher(std::move(state));
}

template <typename Message>
Status Publisher<Message>::publish(const Message& message) {
  const typename Traits<Message>::Wire wire = Traits<Message>::to(message);
  const dds_return_t code = dds_write(state_->handle, &wire);
  if (code < 0) return Error{std::string("DDS write: ") + dds_strretcode(code)};
  return done;
}

template <typename Message>
int Publisher<Message>::readers() const {
  dds_publication_matched_status_t status{};
  if (dds_get_publication_matched_status(state_->handle, &status) < 0) return 0;
  return static_cast<int>(status.current_count);
}

template <typename Message>
struct Subscriber<Message>::State : Entity {
  Callback on_message;

  static void data_available(dds_entity_t reader, void* argument) {
    const auto& self = *static_cast<const State*>(argument);
    std::array<void*, history_depth> samples{};
    std::array<dds_sample_info_t, history_depth> infos{};
    // Loaned samples: the first entry is null, DDS lends its own memory.
    const dds_return_t count = dds_take(reader, samples.data(), infos.data(), samples.size(), history_depth);
    if (count <= 0) return;  // nothing, or the reader is being deleted
    for (dds_return_t i = 0; i < count; ++i) {
      if (infos[i].valid_data)
        self.on_message(Traits<Message>::from(*static_cast<const typename Traits<Message>::Wire*>(samples[i])));
    }
    dds_return_loan(reader, samples.data(), count);
  }
};

template <typename Message>
Subscriber<Message>::Subscriber(std::unique_ptr<State> state) : state_(std::move(state)) {}
template <typename Message>
Subscriber<Message>::Subscriber(Subscriber&&) noexcept = default;
template <typename Message>
Subscriber<Message>& Subscriber<Message>::operator=(Subscriber&&) noexcept = default;
template <typename Message>
Subscriber<Message>::~Subscriber() = default;

template <typename Message>
Result<Subscriber<Message>> Subscriber<Message>::create(ParticipantPtr participant, const std::string& topic,
                                                        Callback on_message) {
  auto state = std::make_unique<State>();
  state->on_message = std::move(on_message);
  if (auto opened = open_topic<Message>(*state, std::move(participant), topic); !opened) return opened.error();
  const Qos qos = make_qos(DDS_RELIABILITY_BEST_EFFORT);
  const std::unique_ptr<dds_listener_t, ListenerDelete> listener(dds_create_listener(state.get()));
  dds_lset_data_available(listener.get(), &State::data_available);
  state->handle = dds_create_reader(state->participant->handle(), state->topic, qos.get(), listener.get());
  if (state->handle < 0) return Error{"DDS reader of " + topic + ": " + dds_strretcode(state->handle)};
  return Subscriber(std::move(state));
}

template <typename Message>
int Subscriber<Message>::writers() const {
  dds_subscription_matched_status_t status{};
  if (dds_get_subscription_matched_status(state_->handle, &status) < 0) return 0;
  return static_cast<int>(status.current_count);
}

template class Publisher<PoseStamped>;
template class Publisher<Odometry>;
template class Publisher<Twist>;
template class Subscriber<PoseStamped>;
template class Subscriber<Odometry>;
template class Subscriber<Twist>;

}  // namespace ledgerline::dds
