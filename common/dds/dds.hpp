#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/msg/ros.hpp"
#include "common/rt/result.hpp"

/// ROS 2 topics over Cyclone DDS: names, types and QoS are those of a ROS 2 node, so a ROS 2 machine sees them. Topics
/// are given as in ROS ("/tello1/odom"); on the wire they are "rt/tello1/odom". No type of DDS is visible here.
namespace ledgerline::dds {

struct ParticipantOptions {
  /// Loopback only, discovery included; works whether or not lo can multicast. CYCLONEDDS_URI, where it is set, decides
  /// instead.
  bool local_only = true;
  /// Else ROS_DOMAIN_ID, else 0. A ROS_DOMAIN_ID that is no number of 0..232 is an error.
  std::optional<std::uint32_t> domain;
};

/// A process's place in a DDS domain; one is enough. Thread-safe. Publishers and subscribers keep it alive. The first
/// one of a process decides how its domain is reached: a second for the same domain shares the first one's interfaces.
class Participant {
 public:
  static Result<std::shared_ptr<Participant>> create(const ParticipantOptions& options = {});
  ~Participant();
  Participant(const Participant&) = delete;
  Participant& operator=(const Participant&) = delete;

  int handle() const { return handle_; }

 private:
  explicit Participant(int handle) : handle_(handle) {}
  int handle_;
};
using ParticipantPtr = std::shared_ptr<Participant>;

/// geometry_msgs/msg/PoseStamped.
struct PoseStamped {
  Header header;  ///< real time
  std::array<double, 3> position_m{};
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< x, y, z, w
};

/// geometry_msgs/msg/Twist.
struct Twist {
  std::array<double, 3> linear_mps{};
  std::array<double, 3> angular_radps{};
};

/// Publishes messages of one type, as a ROS 2 publisher does by default (reliable, keep last 10, volatile). Movable.
/// publish() may be called from any thread, waits for no reader (the oldest message is overwritten), and costs some
/// microseconds and a heap allocation inside DDS: not for the real-time loop.
template <typename Message>
class Publisher {
 public:
  static Result<Publisher> create(ParticipantPtr participant, const std::string& topic);
  Publisher(Publisher&&) noexcept;
  Publisher& operator=(Publisher&&) noexcept;
  ~Publisher();

  Status publish(const Message& message);
  /// Readers that are matched now.
  int readers() const;

 private:
  struct State;
  explicit Publisher(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Calls `on_message` for each message, on a thread of DDS: hand over and return. Keeps the newest 10 not yet taken;
/// best effort, so it hears reliable and best-effort writers alike, and a lost message is not sent again. After the
/// destructor no call is running and none will come.
template <typename Message>
class Subscriber {
 public:
  using Callback = std::function<void(const Message&)>;
  static Result<Subscriber> create(ParticipantPtr participant, const std::string& topic, Callback on_message);
  Subscriber(Subscriber&&) noexcept;
  Subscriber& operator=(Subscriber&&) noexcept;
  ~Subscriber();

  /// Writers that are matched now.
  int writers() const;

 private:
  struct State;
  explicit Subscriber(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

using PosePublisher = Publisher<PoseStamped>;
using PoseSubscriber = Subscriber<PoseStamped>;  ///< mocap: "/vrpn_mocap/<drone>/pose"
using OdometryPublisher = Publisher<Odometry>;   ///< "/<drone>/odom"
using OdometrySubscriber = Subscriber<Odometry>;
using TwistPublisher = Publisher<Twist>;
using TwistSubscriber = Subscriber<Twist>;  ///< "/<drone>/cmd_vel"

/// "/a/b" -> "rt/a/b". A name that is empty, relative or has characters that ROS 2 does not allow is an error.
Result<std::string> dds_topic(const std::string& ros_topic);

}  // namespace ledgerline::dds
