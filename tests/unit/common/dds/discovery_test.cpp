#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "common/dds/dds.hpp"
#include "common/dds/endpoint.hpp"
#include "common/msg/cdr.hpp"
#include "tests/unit/common/dds/domain.hpp"

namespace ledgerline::dds {
namespace {

constexpr const char* nested = "made_up_msgs/msg/Nested";
constexpr const char* other_type = "made_up_msgs/msg/Other";

void ignore(std::span<const std::uint8_t>, const RawInfo&) {}

class Topics : public testing::Test {
 protected:
  void SetUp() override {
    for (ParticipantPtr* p : {&own_, &other_}) {
      auto made = Participant::create(on_own_domain());
      ASSERT_TRUE(made) << made.error().message;
      *p = *made;
    }
  }
  Discovery watch(std::size_t bound = 100) {
    auto made = Discovery::create(
        own_,
        [this](const DiscoveredTopic& seen) {
          if (seen.topic.starts_with("/seen/")) seen_.add(seen);
        },
        bound);
    if (!made) throw std::runtime_error(made.error().message);
    return std::move(*made);
  }
  static RawWriter writer(const ParticipantPtr& p, const char* topic, const char* type = nested, const Qos& qos = {}) {
    auto made = RawWriter::create(p, topic, type, qos);
    if (!made) throw std::runtime_error(made.error().message);
    return std::move(*made);
  }
  static RawReader reader(const ParticipantPtr& p, const char* topic, const char* type = nested, const Qos& qos = {}) {
    auto made = RawReader::create(p, topic, type, qos, ignore);
    if (!made) throw std::runtime_error(made.error().message);
    return std::move(*made);
  }
  /// The n-th notification.
  DiscoveredTopic reported(std::size_t n) {
    if (!seen_.wait_for(n + 1)) throw std::runtime_error("no further notification came");
    return seen_.items()[n];
  }

  ParticipantPtr own_, other_;
  Inbox<DiscoveredTopic> seen_;
};

TEST_F(Topics, AreReportedAsTheyAppearChangeAndVanish) {
  const auto before = writer(other_, "/seen/early", nested, {.transient_local = true, .depth = 3});
  const Discovery discovery = watch();
  EXPECT_EQ(reported(0), (DiscoveredTopic{"/seen/early", nested, {true, true, 3}, 1, 0, false}));
  {
    const auto reads = reader(other_, "/seen/late", nested, {.reliable = false});
    EXPECT_EQ(reported(1), (DiscoveredTopic{"/seen/late", nested, reported(1).qos, 0, 1, false}));
    EXPECT_FALSE(reported(1).qos.reliable);
    const auto writes = writer(other_, "/seen/late");
    EXPECT_EQ(reported(2), (DiscoveredTopic{"/seen/late", nested, {true, false, 10}, 1, 1, false}));
  }
  EXPECT_EQ(reported(3).writers, 0);
  EXPECT_EQ(reported(3).readers, 1);
  EXPECT_EQ(reported(4), (DiscoveredTopic{"/seen/late", nested, {}, 0, 0, false}));
}

TEST_F(Topics, ATypeThatChangesVanishesAndAppears) {
  const Discovery discovery = watch();
  for (const char* type : {nested, other_type}) {
    const auto writes = writer(other_, "/seen/changing", type);
    ASSERT_TRUE(seen_.wait_for(type == nested ? 1 : 3));
  }
  EXPECT_EQ(reported(0).type, nested);
  EXPECT_EQ(reported(1), (DiscoveredTopic{"/seen/changing", nested, {}, 0, 0, false}));
  EXPECT_EQ(reported(2).type, other_type);
  EXPECT_EQ(reported(2).writers, 1);
  EXPECT_FALSE(reported(2).clash);
  EXPECT_EQ(reported(3), (DiscoveredTopic{"/seen/changing", other_type, {}, 0, 0, false}));
}

TEST_F(Topics, ATypeClashWithOthersOrWithUsIsReported) {
  const Discovery discovery = watch();
  const auto one = writer(other_, "/seen/clash");
  EXPECT_FALSE(reported(0).clash);
  {
    const auto two = writer(other_, "/seen/clash", other_type);
    ASSERT_TRUE(seen_.wait_for(3));
    EXPECT_TRUE(reported(1).clash);
    EXPECT_TRUE(reported(2).clash);
    EXPECT_NE(reported(1).type, reported(2).type);
  }
  EXPECT_EQ(reported(3), (DiscoveredTopic{"/seen/clash", other_type, {}, 0, 0, false}));
  EXPECT_EQ(reported(4), (DiscoveredTopic{"/seen/clash", nested, {}, 1, 0, false}));
  const auto ours = reader(own_, "/seen/clash", other_type);
  EXPECT_EQ(reported(5), (DiscoveredTopic{"/seen/clash", nested, {}, 1, 0, true}));
  EXPECT_EQ(ours.writers(), 0);
}

TEST_F(Topics, TheQosIsOneThatHearsAllWritersAndSatisfiesAllReaders) {
  const auto a = writer(other_, "/seen/offered", nested, {.reliable = true, .transient_local = true});
  const auto b = writer(other_, "/seen/offered", nested, {.reliable = false, .transient_local = true});
  const auto c = reader(other_, "/seen/wanted", nested, {.reliable = true, .transient_local = false});
  const auto d = reader(other_, "/seen/wanted", nested, {.reliable = false, .transient_local = true});
  const Discovery discovery = watch();
  const auto last_of = [&](const std::string& topic) {
    DiscoveredTopic last;
    for (const DiscoveredTopic& seen : seen_.items()) {
      if (seen.topic == topic) last = seen;
    }
    return last;
  };
  ASSERT_TRUE(
      eventually([&] { return last_of("/seen/offered").writers == 2 && last_of("/seen/wanted").readers == 2; }));
  EXPECT_FALSE(last_of("/seen/offered").qos.reliable);
  EXPECT_TRUE(last_of("/seen/offered").qos.transient_local);
  EXPECT_TRUE(last_of("/seen/wanted").qos.reliable);
  EXPECT_TRUE(last_of("/seen/wanted").qos.transient_local);
}

TEST_F(Topics, ServicesTopicsAndOurOwnAreLeftOut) {
  const Discovery discovery = watch();
  Endpoint service;
  ASSERT_TRUE(service.open_writer(other_->handle(), "rq/seen/serviceRequest", "made_up::srv::dds_::Add_Request_", {}));
  const auto ours = writer(own_, "/seen/ours");
  const auto theirs = writer(other_, "/seen/theirs");
  EXPECT_EQ(reported(0).topic, "/seen/theirs");
  EXPECT_EQ(seen_.items().size(), 1u);
}

TEST_F(Topics, WhoWritesWhatIsReadAndIsNotHeardIsReportedOnce) {
  Inbox<std::string> reports;
  const auto early = writer(other_, "/seen/cmd_vel", other_type);
  const auto reporting = report_unheard(
      own_, {{"/seen/cmd_vel", nested, {.reliable = false}}, {"/seen/takeoff", nested, {}}, {"/seen/land", nested, {}}},
      [&](std::size_t read, const std::string& why) { reports.add(std::to_string(read) + " " + why); });
  ASSERT_TRUE(reporting) << reporting.error().message;
  ASSERT_TRUE(reports.wait_for(1));
  EXPECT_EQ(reports.items()[0],
            "0 /seen/cmd_vel is written as made_up_msgs/msg/Other; made_up_msgs/msg/Nested is read");
  const auto again = writer(other_, "/seen/cmd_vel", other_type);
  const auto heard = writer(other_, "/seen/cmd_vel", nested, {.reliable = false});
  const auto fits = writer(other_, "/seen/land");
  const auto elsewhere = writer(other_, "/seen/elsewhere", other_type);
  const auto weak = writer(other_, "/seen/takeoff", nested, {.reliable = false});
  ASSERT_TRUE(reports.wait_for(2));
  EXPECT_THAT(reports.items()[1], testing::StartsWith("1 /seen/takeoff is written best effort; it is read reliable"));
  EXPECT_EQ(reports.items().size(), 2u);
}

TEST_F(Topics, WhoComesLaterAndIsNotHeardIsReportedToo) {
  Inbox<std::string> reports;
  const auto reporting = report_unheard(own_, {{"/seen/cmd_vel", nested, {.reliable = false}}},
                                        [&](std::size_t, const std::string& why) { reports.add(why); });
  ASSERT_TRUE(reporting) << reporting.error().message;
  for (std::size_t n = 1; n <= 2; ++n) {
    {
      const auto wrong = writer(other_, "/seen/cmd_vel", other_type);
      ASSERT_TRUE(reports.wait_for(2 * n - 1));
    }
    ASSERT_TRUE(reports.wait_for(2 * n));
    EXPECT_THAT(reports.items()[2 * n - 2], testing::HasSubstr("is written as"));
    EXPECT_EQ(reports.items()[2 * n - 1], "") << "nobody does any more";
  }
}

TEST_F(Topics, EndpointsBeyondTheBoundAreLeftOutAndCounted) {
  const auto one = writer(other_, "/seen/one");
  const Discovery discovery = watch(1);
  const auto two = writer(other_, "/seen/two");
  EXPECT_TRUE(eventually([&] { return discovery.left_out() == 1; }));
  EXPECT_EQ(seen_.items().size(), 1u);
}

struct Node {
  std::string space, name;
  std::size_t readers = 0, writers = 0;
  bool operator==(const Node&) const = default;
};

/// As a ROS 2 tool reads ros_discovery_info; node names alone.
class NodeReader {
 public:
  explicit NodeReader(const ParticipantPtr& participant, std::size_t gid_bytes) : gid_bytes_(gid_bytes) {
    opened_ = endpoint_
                  .open_reader(participant->handle(), "ros_discovery_info",
                               "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
                               {.transient_local = true, .depth = 1}, &NodeReader::changed, this)
                  .ok();
  }
  bool opened() const { return opened_; }
  bool sees(const Node& node) {
    return eventually([&] {
      const auto reported = nodes_.items();
      return !reported.empty() && reported.back() == node;
    });
  }

 private:
  static void changed(dds_entity_t reader, void* self) { static_cast<NodeReader*>(self)->read(reader); }
  void read(dds_entity_t reader) {
    ddsi_serdata* message = nullptr;
    dds_sample_info_t info{};
    while (dds_takecdr(reader, &message, 1, &info, DDS_ANY_STATE) > 0) {
      if (info.valid_data) {
        CdrReader in({reinterpret_cast<const char*>(bytes_of(message).data()), bytes_of(message).size()});
        skip(in, 1);
        EXPECT_EQ(in.get<std::uint32_t>(), 1u);
        Node node;
        node.space = in.get_string();
        node.name = in.get_string();
        skip(in, node.readers = in.get<std::uint32_t>());
        skip(in, node.writers = in.get<std::uint32_t>());
        EXPECT_TRUE(in.ok());
        nodes_.add(node);
      }
      ddsi_serdata_unref(message);
    }
  }
  void skip(CdrReader& in, std::size_t gids) const {
    for (std::size_t i = 0; i < gids * gid_bytes_; ++i) (void)in.get<std::uint8_t>();
  }

  std::size_t gid_bytes_;
  bool opened_ = false;
  Inbox<Node> nodes_;
  Endpoint endpoint_;
};

TEST(NodeOfRos, IsListedWithItsReadersAndWritersAsTheyComeAndGo) {
  ParticipantOptions options = on_own_domain();
  options.node = "/fleet/listed";
  auto participant = Participant::create(options);
  auto tool = Participant::create(on_own_domain());
  ASSERT_TRUE(participant && tool);
  NodeReader nodes(*tool, 16);
  ASSERT_TRUE(nodes.opened());
  EXPECT_TRUE(nodes.sees({"/fleet", "listed", 0, 0}));
  {
    auto w = RawWriter::create(*participant, "/a", nested, {});
    auto r = RawReader::create(*participant, "/b", nested, {}, ignore);
    ASSERT_TRUE(w && r);
    EXPECT_TRUE(nodes.sees({"/fleet", "listed", 1, 1}));
  }
  EXPECT_TRUE(nodes.sees({"/fleet", "listed", 0, 0}));
}

TEST(NodeOfRos, SpeaksAsTheReleaseThatIsUsedHere) {
  setenv("ROS_DISTRO", "humble", 1);
  ParticipantOptions options = on_own_domain();
  options.node = "older";
  auto participant = Participant::create(options);
  unsetenv("ROS_DISTRO");
  auto tool = Participant::create(on_own_domain());
  ASSERT_TRUE(participant && tool);
  NodeReader nodes(*tool, 24);
  EXPECT_TRUE(nodes.sees({"/", "older", 0, 0}));
}

TEST(NodeOfRos, ANameThatRosDoesNotAllowIsAnError) {
  ParticipantOptions options = on_own_domain();
  options.node = "two words";
  auto refused = Participant::create(options);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, testing::HasSubstr("two words"));
}

}  // namespace
}  // namespace ledgerline::dds
