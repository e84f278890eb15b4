// A pilot on Fast DDS who knows nothing of this project, reached as a node of ROS 2 with rmw_fastrtps is:
// fast_dds_peer RELEASE DRONE FORWARD_MPS METRES, on the domain ROS_DOMAIN_ID. RELEASE humble: ROS_LOCALHOST_ONLY=1;
// jazzy: ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST. It takes off, flies ahead, lands, and says so as lines of JSON.
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace {

namespace fast = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using Bytes = std::vector<unsigned char>;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

/// Any type of ROS 2: its CDR, header included.
class Cdr : public fast::TopicDataType {
 public:
  explicit Cdr(const char* name) {
    setName(name);
    m_typeSize = 1000;
    m_isGetKeyDefined = false;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
    const Bytes& bytes = *static_cast<Bytes*>(data);
    if (bytes.size() > payload->max_size) return false;
    std::memcpy(payload->data, bytes.data(), bytes.size());
    payload->length = static_cast<std::uint32_t>(bytes.size());
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
    static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
};

/// As rmw_fastrtps makes it.
fast::DomainParticipantQos reached_as(const std::string& release) {
  fast::DomainParticipantQos qos;
  auto& builtin = qos.wire_protocol().builtin;
  builtin.readerHistoryMemoryPolicy = builtin.writerHistoryMemoryPolicy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  const auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  qos.transport().use_builtin_transports = false;  // no shared memory: only Fast DDS has that one
  qos.transport().user_transports.push_back(udp);
  if (release == "humble") {
    udp->interfaceWhiteList.emplace_back("127.0.0.1");
  } else {
    builtin.metatrafficMulticastLocatorList.clear();
    builtin.metatrafficUnicastLocatorList.push_back(rtps::Locator_t());
    rtps::Locator_t peer;
    rtps::IPLocator::setIPv4(peer, "127.0.0.1");
    builtin.initialPeersList.push_back(peer);
  }
  return qos;
}

struct Position {
  double x, y, z;
};

/// Of a nav_msgs/msg/Odometry: its first doubles stand behind a stamp and two texts.
std::optional<Position> position_of(const Bytes& cdr) {
  std::size_t at = 4 + 8;
  for (int text = 0; text < 2; ++text) {
    at = (at + 3) / 4 * 4;
    std::uint32_t length = 0;
    if (cdr.size() < at + 4) return std::nullopt;
    std::memcpy(&length, &cdr[at], 4);
    at += 4 + std::size_t{length};
  }
  at = (at - 4 + 7) / 8 * 8 + 4;
  Position position{};
  if (cdr.size() < at + sizeof position) return std::nullopt;
  std::memcpy(&position, &cdr[at], sizeof position);
  return position;
}

class Pilot {
 public:
  Pilot(fast::DomainParticipant* participant, const std::string& drone)
      : participant_(participant),
        subscriber_(participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT)),
        publisher_(participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT)) {
    fast::DataReaderQos qos;
    qos.reliability().kind = fast::BEST_EFFORT_RELIABILITY_QOS;
    qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    odom_ = subscriber_->create_datareader(topic("rt/" + drone + "/odom", "nav_msgs::msg::dds_::Odometry_"), qos);
    takeoff_ = writer("rt/" + drone + "/takeoff", "std_msgs::msg::dds_::Empty_");
    land_ = writer("rt/" + drone + "/land", "std_msgs::msg::dds_::Empty_");
    cmd_vel_ = writer("rt/" + drone + "/cmd_vel", "geometry_msgs::msg::dds_::Twist_");
  }

  void fly(double forward_mps, double metres) {
    wait([&] { return newest_.has_value(); });
    std::printf("{\"odom\":%.3f}\n", newest_->z);
    for (fast::DataWriter* one : {takeoff_, land_, cmd_vel_}) {
      fast::PublicationMatchedStatus status;
      wait([&] { return one->get_publication_matched_status(status), status.current_count > 0; });
    }
    std::printf("{\"matched\":true}\n");
    wait([&] { return press(takeoff_), newest_->z > 0.5; });
    const Position begin = *newest_;
    Bytes twist{0, 1, 0, 0};
    twist.resize(4 + 48);
    std::memcpy(&twist[4], &forward_mps, sizeof forward_mps);
    const auto flown = [&] { return std::hypot(newest_->x - begin.x, newest_->y - begin.y); };
    wait([&] { return cmd_vel_->write(&twist), flown() > metres; });
    std::printf("{\"flown_m\":%.3f}\n", flown());
    pressed_ = {};
    wait([&] { return press(land_), newest_->z < 0.15; });
    std::printf("{\"landed\":true}\n");
  }

 private:
  fast::Topic* topic(const std::string& name, const char* type) {
    fast::TypeSupport(new Cdr(type)).register_type(participant_);
    return participant_->create_topic(name, type, fast::TOPIC_QOS_DEFAULT);
  }
  fast::DataWriter* writer(const std::string& name, const char* type) {
    fast::DataWriterQos qos;
    qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return publisher_->create_datawriter(topic(name, type), qos);
  }
  /// As a person does: again where nothing comes of it.
  void press(fast::DataWriter* button) {
    if (Clock::now() < pressed_ + milliseconds(5000)) return;
    pressed_ = Clock::now();
    Bytes empty{0, 1, 0, 0, 0};
    button->write(&empty);
  }
  template <typename Condition>
  void wait(Condition holds) {
    std::fflush(stdout);
    Bytes cdr;
    fast::SampleInfo info;
    for (;;) {
      while (odom_->take_next_sample(&cdr, &info) == ReturnCode_t::RETCODE_OK)
        if (info.valid_data) newest_ = position_of(cdr);
      if (holds()) return;
      std::this_thread::sleep_for(milliseconds(50));
    }
  }

  fast::DomainParticipant* participant_;
  fast::Subscriber* subscriber_;
  fast::Publisher* publisher_;
  fast::DataReader* odom_ = nullptr;
  fast::DataWriter *takeoff_ = nullptr, *land_ = nullptr, *cmd_vel_ = nullptr;
  std::optional<Position> newest_;
  Clock::time_point pressed_{};
};

}  // namespace

int main(int argc, char** argv) {
  const char* domain = std::getenv("ROS_DOMAIN_ID");
  if (argc != 5 || !domain) return 2;
  auto* participant = fast::DomainParticipantFactory::get_instance()->create_participant(
      static_cast<std::uint32_t>(std::atoi(domain)), reached_as(argv[1]));
  if (!participant) return 1;
  Pilot(participant, argv[2]).fly(std::atof(argv[3]), std::atof(argv[4]));
  std::fflush(stdout);
  std::_Exit(0);  // entities end with the process
}
