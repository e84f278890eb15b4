#include "common/dds/dds.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>

#include "common/dds/endpoint.hpp"
#include "tests/unit/common/dds/domain.hpp"

namespace ledgerline::dds {
namespace {

using testing::HasSubstr;

constexpr const char* made_up = "made_up_msgs/msg/Nested";

struct Received {
  Bytes cdr;
  RawInfo info;
};

/// Two participants with a topic between them.
class Raw : public testing::Test {
 protected:
  void SetUp() override {
    for (ParticipantPtr* p : {&says_, &hears_}) {
      auto made = Participant::create(on_own_domain());
      ASSERT_TRUE(made) << made.error().message;
      *p = *made;
    }
  }
  RawWriter writer(const std::string& topic, const Qos& qos = {}, const char* type = made_up) {
    auto made = RawWriter::create(says_, topic, type, qos);
    if (!made) throw std::runtime_error(made.error().message);
    return std::move(*made);
  }
  RawReader reader(const std::string& topic, const Qos& qos = {}, const char* type = made_up) {
    auto made =
        RawReader::create(hears_, topic, type, qos, [this](std::span<const std::uint8_t> cdr, const RawInfo& i) {
          inbox_.add({copy_of(cdr), i});
        });
    if (!made) throw std::runtime_error(made.error().message);
    return std::move(*made);
  }
  static bool matched(const RawWriter& w, const RawReader& r) {
    return eventually([&] { return w.readers() > 0 && r.writers() > 0; });
  }

  ParticipantPtr says_, hears_;
  Inbox<Received> inbox_;
};

TEST_F(Raw, BytesOfAnyLengthAndEitherByteOrderArriveAsTheyWerePublished) {
  auto r = reader("/raw/lengths", {.depth = 100});
  auto w = writer("/raw/lengths", {.depth = 100});
  ASSERT_TRUE(matched(w, r));
  std::vector<Bytes> sent;
  for (const std::size_t size : {4, 5, 6, 7, 8, 9, 64, 1001, 200'003}) {
    for (const bool little : {false, true}) sent.push_back(message_of(size, 7, little));
  }
  for (const Bytes& cdr : sent) ASSERT_TRUE(w.publish(cdr));
  ASSERT_TRUE(inbox_.wait_for(sent.size()));
  const auto got = inbox_.items();
  for (std::size_t i = 0; i < sent.size(); ++i) EXPECT_EQ(got[i].cdr, sent[i]) << i;
}

TEST_F(Raw, AMessageTellsItsTimeAndItsWriter) {
  auto r = reader("/raw/info");
  auto one = writer("/raw/info");
  ASSERT_TRUE(matched(one, r));
  const TimeNs before = realtime_ns();
  ASSERT_TRUE(one.publish(message_of(8, 1)));
  ASSERT_TRUE(one.publish(message_of(8, 2)));
  ASSERT_TRUE(inbox_.wait_for(2));
  auto other = writer("/raw/info");
  ASSERT_TRUE(eventually([&] { return r.writers() == 2 && other.readers() == 1; }));
  ASSERT_TRUE(other.publish(message_of(8, 3)));
  ASSERT_TRUE(inbox_.wait_for(3));
  const auto got = inbox_.items();
  EXPECT_GE(got[0].info.source_time_ns, before);
  EXPECT_LE(got[2].info.source_time_ns, realtime_ns());
  EXPECT_NE(got[0].info.writer, Guid{});
  EXPECT_EQ(got[0].info.writer, got[1].info.writer);
  EXPECT_NE(got[1].info.writer, got[2].info.writer);
}

TEST_F(Raw, WhatAParticipantWroteItselfDoesNotComeBack) {
  auto theirs = reader("/raw/echo");
  Inbox<Bytes> echoes;
  auto own = RawReader::create(says_, "/raw/echo", made_up, {},
                               [&](std::span<const std::uint8_t> cdr, const RawInfo&) { echoes.add(copy_of(cdr)); });
  ASSERT_TRUE(own);
  auto w = writer("/raw/echo");
  ASSERT_TRUE(matched(w, theirs));
  for (std::uint32_t i = 0; i < 10; ++i) ASSERT_TRUE(w.publish(message_of(8, i)));
  ASSERT_TRUE(inbox_.wait_for(10));
  EXPECT_TRUE(echoes.items().empty());
  EXPECT_EQ(own->writers(), 0);
}

TEST_F(Raw, ALateJoinerGetsTheLastMessagesOfATransientLocalWriterAlone) {
  const Qos latched{.transient_local = true, .depth = 2};
  auto w = writer("/raw/latched", latched);
  auto forgets = writer("/raw/forgotten", {.depth = 2});
  for (std::uint32_t i = 1; i <= 3; ++i) {
    ASSERT_TRUE(w.publish(message_of(8, i)));
    ASSERT_TRUE(forgets.publish(message_of(8, 10 + i)));
  }
  auto late = reader("/raw/latched", latched);
  auto late_too = reader("/raw/forgotten");
  ASSERT_TRUE(inbox_.wait_for(2));
  ASSERT_TRUE(matched(forgets, late_too));
  ASSERT_TRUE(forgets.publish(message_of(8, 20)));
  ASSERT_TRUE(inbox_.wait_for(3));
  const auto got = inbox_.items();
  EXPECT_EQ(got[0].cdr, message_of(8, 2));
  EXPECT_EQ(got[1].cdr, message_of(8, 3));
  EXPECT_EQ(got[2].cdr, message_of(8, 20));
}

TEST_F(Raw, WhatIsNoPlainCdrOrTooLongIsRefusedAndCounted) {
  auto w = writer("/raw/refused");
  for (const Bytes& wrong : {Bytes{}, Bytes{0, 1, 0}, Bytes{0, 7, 0, 0, 1}, Bytes{1, 0, 0, 0, 1}}) {
    const auto refused = w.publish(wrong);
    ASSERT_FALSE(refused);
    EXPECT_THAT(refused.error().message, HasSubstr("encapsulation header"));
  }
  EXPECT_FALSE(w.publish(message_of(max_message_bytes + 1, 1)));
  EXPECT_TRUE(w.publish(message_of(max_message_bytes, 1)));
  EXPECT_EQ(w.refused().malformed, 4u);
  EXPECT_EQ(w.refused().too_long, 1u);
}

/// A writer of another kind, which checks nothing: the header is spoiled after ours let it pass.
TEST_F(Raw, AMalformedMessageOfAnotherWriterIsCountedAndTheNextOneComes) {
  auto r = reader("/raw/hostile");
  auto refused = std::make_shared<RefusedCounters>();
  ddsi_sertype* type = make_raw_type("made_up_msgs::msg::dds_::Nested_", refused);
  const dds_entity_t topic =
      dds_create_topic_sertype(says_->handle(), "rt/raw/hostile", &type, nullptr, nullptr, nullptr);
  ASSERT_GT(topic, 0);
  const QosPtr qos(dds_create_qos());
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  const dds_entity_t hostile = dds_create_writer(says_->handle(), topic, qos.get(), nullptr);
  ASSERT_GT(hostile, 0);
  ASSERT_TRUE(eventually([&] { return r.writers() == 1; }));
  const auto send = [&](std::uint8_t spoil_at, std::uint8_t with) {
    ddsi_serdata* message = make_raw_message(type, message_of(8, 5));
    const_cast<std::uint8_t*>(bytes_of(message).data())[spoil_at] = with;
    ASSERT_EQ(dds_writecdr(hostile, message), DDS_RETCODE_OK);
  };
  send(1, 9);   // XCDR2
  send(0, 77);  // nothing at all
  send(7, 0);   // the message's own bytes are nobody's business
  ASSERT_TRUE(inbox_.wait_for(1));
  EXPECT_EQ(inbox_.items().size(), 1u);
  EXPECT_EQ(r.refused().malformed, 2u);
  dds_delete(hostile);
  dds_delete(topic);
}

TEST_F(Raw, TwoTypesOnOneTopicDoNotHearEachOther) {
  auto r = reader("/raw/clash", {}, "made_up_msgs/msg/Other");
  auto w = writer("/raw/clash");
  auto fitting = reader("/raw/clash_no_more");
  auto w2 = writer("/raw/clash_no_more");
  ASSERT_TRUE(matched(w2, fitting));  // by now the other two would have met, too
  ASSERT_TRUE(w.publish(message_of(8, 1)));
  ASSERT_TRUE(w2.publish(message_of(8, 2)));
  ASSERT_TRUE(inbox_.wait_for(1));
  EXPECT_EQ(inbox_.items()[0].cdr, message_of(8, 2));
  EXPECT_EQ(r.writers(), 0);
  EXPECT_EQ(w.readers(), 0);
  auto also = writer("/raw/clash", {}, "made_up_msgs/msg/Other");
  EXPECT_TRUE(matched(also, r));
  EXPECT_EQ(r.writers(), 1);
}

TEST_F(Raw, NoCallComesAfterAReaderIsGone) {
  auto w = writer("/gone");
  auto calls = std::make_unique<std::atomic<int>>(0);
  {
    auto r = RawReader::create(hears_, "/gone", made_up, {},
                               [&](std::span<const std::uint8_t>, const RawInfo&) { calls->fetch_add(1); });
    ASSERT_TRUE(r);
    ASSERT_TRUE(matched(w, *r));
    for (std::uint32_t i = 0; i < 200; ++i) ASSERT_TRUE(w.publish(message_of(8, i)));
  }
  calls.reset();  // a late call would now use freed memory, which the sanitizers see
  for (std::uint32_t i = 0; i < 200; ++i) ASSERT_TRUE(w.publish(message_of(8, i)));
}

TEST(Names, AreRos2s) {
  EXPECT_EQ(*dds_topic("/tello1/odom"), "rt/tello1/odom");
  for (const char* wrong : {"", "/", "tello1/odom", "/a//b", "/a/", "/a b", "/a-b"})
    EXPECT_FALSE(dds_topic(wrong)) << wrong;
  EXPECT_EQ(*dds_type("nav_msgs/msg/Odometry"), "nav_msgs::msg::dds_::Odometry_");
  for (const char* wrong : {"", "Odometry", "nav_msgs/Odometry", "nav_msgs/msg/", "nav_msgs/msg/a/b", "a b/msg/C"})
    EXPECT_FALSE(dds_type(wrong)) << wrong;
  EXPECT_EQ(ros_topic("rt/tello1/odom"), "/tello1/odom");
  EXPECT_EQ(ros_type("nav_msgs::msg::dds_::Odometry_"), "nav_msgs/msg/Odometry");
  for (const char* wrong : {"", "rt/", "rt", "rq/add/_request", "ros_discovery_info", "rt/a b"})
    EXPECT_EQ(ros_topic(wrong), "") << wrong;
  for (const char* wrong :
       {"", "Odometry", "nav_msgs::msg::Odometry_", "nav_msgs::msg::dds_::Odometry", "a::b::dds_::_"})
    EXPECT_EQ(ros_type(wrong), "") << wrong;
}

TEST(Domain, ComesFromRosAndANonsenseOneIsAnError) {
  setenv("ROS_DOMAIN_ID", "300", 1);
  auto refused = Participant::create();
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("ROS_DOMAIN_ID"));
  setenv("ROS_DOMAIN_ID", "4x", 1);
  EXPECT_FALSE(Participant::create());

  setenv("ROS_DOMAIN_ID", "97", 1);
  auto by_name = Participant::create();
  unsetenv("ROS_DOMAIN_ID");
  ASSERT_TRUE(by_name) << by_name.error().message;
  ParticipantOptions same;
  same.domain = 97;
  auto by_number = Participant::create(same);
  ASSERT_TRUE(by_number);
  auto w = RawWriter::create(*by_name, "/here", made_up, {});
  auto r = RawReader::create(*by_number, "/here", made_up, {}, [](std::span<const std::uint8_t>, const RawInfo&) {});
  ASSERT_TRUE(w && r);
  EXPECT_TRUE(eventually([&] { return w->readers() > 0 && r->writers() > 0; }));
}

/// CYCLONEDDS_URI for as long as it lives, with which no participant can be made.
class NonsenseInEnvironment {
 public:
  NonsenseInEnvironment() { setenv("CYCLONEDDS_URI", "<CycloneDDS><Nonsense/></CycloneDDS>", 1); }
  ~NonsenseInEnvironment() { unsetenv("CYCLONEDDS_URI"); }
  NonsenseInEnvironment(const NonsenseInEnvironment&) = delete;
  NonsenseInEnvironment& operator=(const NonsenseInEnvironment&) = delete;
};

ParticipantOptions on_domain(std::uint32_t domain) {
  ParticipantOptions options;
  options.domain = domain;
  return options;
}

TEST(Domain, LoopbackThatTheConfigSaysBeatsTheEnvironment) {
  const NonsenseInEnvironment nonsense;
  ParticipantOptions options = on_domain(94);
  options.local_only = true;
  const auto participant = Participant::create(options);
  EXPECT_TRUE(participant) << participant.error().message;
}

TEST(Domain, WithoutAWordInTheConfigTheEnvironmentDecides) {
  const NonsenseInEnvironment nonsense;
  EXPECT_FALSE(Participant::create(on_domain(93)));
}

TEST(Domain, AFileOfCyclonesThatTheConfigNamesBeatsTheEnvironment) {
  const std::string file = testing::TempDir() + "ledgerline_cyclone_" + std::to_string(::getpid()) + ".xml";
  ParticipantOptions options = on_domain(92);
  options.cyclonedds = file;
  const auto without = Participant::create(options);
  ASSERT_FALSE(without);
  EXPECT_THAT(without.error().message, HasSubstr("cannot read '" + file + "'"));

  const NonsenseInEnvironment nonsense;
  std::ofstream(file) << "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"true\"/>"
                         "</Interfaces></General></Domain></CycloneDDS>";
  EXPECT_TRUE(Participant::create(options));
  std::ofstream(file) << "<CycloneDDS><Nonsense/></CycloneDDS>";
  EXPECT_FALSE(Participant::create(options)) << "it is the file that is read";
  std::filesystem::remove(file);
}

/// What the other process of the test below says, over and over: of one fragment, and of many.
std::vector<Bytes> said() { return {message_of(56, 1), message_of(101, 2, false), message_of(300'002, 3)}; }

TEST(DdsChild, DISABLED_PublishesUntilItIsEnded) {
  auto participant = Participant::create();
  ASSERT_TRUE(participant) << participant.error().message;
  auto w = RawWriter::create(*participant, "/between_processes", made_up, {});
  ASSERT_TRUE(w) << w.error().message;
  for (int i = 0; i < 6000; ++i) {
    for (const Bytes& cdr : said()) (void)w->publish(cdr);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

TEST(Domain, AnotherProcessOfThisMachineIsHeard) {
  const OtherProcess other("DdsChild.*Publishes*");
  ASSERT_TRUE(other.started());
  auto participant = Participant::create(on_own_domain());
  ASSERT_TRUE(participant);
  Inbox<Bytes> inbox;
  auto r = RawReader::create(*participant, "/between_processes", made_up, {},
                             [&](std::span<const std::uint8_t> cdr, const RawInfo&) { inbox.add(copy_of(cdr)); });
  ASSERT_TRUE(r);
  for (const Bytes& cdr : said()) {
    EXPECT_TRUE(eventually([&] { return testing::Value(inbox.items(), testing::Contains(cdr)); }))
        << "nothing of " << cdr.size() << " bytes came over loopback";
  }
  for (const Bytes& cdr : inbox.items()) EXPECT_THAT(said(), testing::Contains(cdr));
}

TEST_F(Raw, ManyTopicsOfOneTypeTakeNoMoreThanTheirRoom) {
  std::set<std::uint32_t> hashes;
  for (int k = 0; k < 100; ++k) {
    ddsi_sertype* const type = make_raw_type(made_up, std::make_shared<RefusedCounters>());
    hashes.insert(type->ops->hash(type));
    ddsi_sertype_unref(type);
  }
  ASSERT_EQ(hashes.size(), 100U) << "Cyclone's table of types would double itself until memory runs out";
  std::vector<RawReader> readers;
  for (int k = 0; k < 100; ++k) readers.push_back(reader("/raw/many" + std::to_string(k)));
  auto w = writer("/raw/many99");
  ASSERT_TRUE(matched(w, readers.back()));
}

}  // namespace
}  // namespace ledgerline::dds
