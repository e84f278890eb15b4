#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sched.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

#include "common/dds/dds.hpp"
#include "common/dds/raw.hpp"
#include "tests/unit/child.hpp"
#include "tests/unit/common/dds/domain.hpp"

/// A program of this host and an outsider at the other end of a cable, each of whom knows our address, our domain and
/// our topic. The program of this host is as ROS 2 since Iron has it: it announces the address of the network
/// interface.
namespace ledgerline::dds {
namespace {

constexpr const char* topic = "/tello1/takeoff";
constexpr const char* type = "std_msgs/msg/UInt64";
constexpr std::uint32_t domain = 41;  // of a network of this test's own
constexpr std::size_t size_of_neighbours = 12, size_of_outsiders = 13;

bool shell(const std::string& command) { return std::system(command.c_str()) == 0; }  // NOLINT: a test's own words

/// Says messages of a size, which tells who says them.
TEST(Outsiders, DISABLED_Sayer) {
  const auto size = static_cast<std::size_t>(std::atoi(std::getenv("SIZE_TO_SAY")));
  auto participant = Participant::create({.domain = domain});
  ASSERT_TRUE(participant) << participant.error().message;
  auto writer = RawWriter::create(*participant, topic, type, {});
  ASSERT_TRUE(writer) << writer.error().message;
  for (int i = 0; i < 6000; ++i) {
    (void)writer->publish(message_of(size, 1));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

bool start_sayer(Child& child, pid_t network, const char* peer, std::size_t size) {
  const std::string uri = fmt::format(
      "<CycloneDDS><Domain id=\"any\"><General><AllowMulticast>false</AllowMulticast></General><Discovery>"
      "<ParticipantIndex>auto</ParticipantIndex><Peers><Peer "
      "address=\"{}\"/></Peers></Discovery></Domain></CycloneDDS>",
      peer);
  return child.start({"/usr/bin/env", "nsenter", "-n", "-t", std::to_string(network), "env", "CYCLONEDDS_URI=" + uri,
                      fmt::format("SIZE_TO_SAY={}", size), "sh", "-c",
                      "echo '\"ready\":true'; exec \"$0\" --gtest_filter=Outsiders.DISABLED_Sayer "
                      "--gtest_also_run_disabled_tests >/dev/null 2>&1",
                      std::filesystem::read_symlink("/proc/self/exe").string()});
}

/// Datagrams that the kernel did not give to the domain's sockets of this network.
std::uint64_t dropped() {
  std::ifstream sockets("/proc/self/net/udp");
  std::uint64_t count = 0;
  std::string line;
  std::getline(sockets, line);
  while (std::getline(sockets, line)) {
    std::istringstream words(line);
    std::string word, address, last;
    words >> word >> address;
    while (words >> word) last = word;
    const std::size_t port = std::stoul(address.substr(address.find(':') + 1), nullptr, 16);
    if (port >= 7400 + 250 * domain && port < 7650 + 250 * domain) count += std::stoull(last);
  }
  return count;
}

TEST(Outsiders, BehindANetworkInterfaceAreNotHeardAndNeighboursOnThisHostAre) {
  if (::unshare(CLONE_NEWNET) != 0) GTEST_SKIP() << "needs root, to make networks";
  Child street, neighbour, outsider;
  ASSERT_TRUE(street.start({"/usr/bin/env", "unshare", "-n", "sh", "-c", "echo '\"ready\":true'; exec sleep 1000"}));
  const std::string there = std::to_string(street.pid());
  ASSERT_TRUE(shell("ip link set lo up && ip link add lan0 type veth peer name eth0 netns " + there +
                    " && ip address add 10.88.1.1/24 dev lan0 && ip link set lan0 up"));
  ASSERT_TRUE(shell("nsenter -n -t " + there +
                    " sh -c 'ip link set lo up && ip address add 10.88.1.2/24 dev eth0 && ip link set eth0 up'"));

  auto participant = Participant::create({.local_only = true, .ros_release = "jazzy", .domain = domain});
  ASSERT_TRUE(participant) << participant.error().message;
  std::atomic<int> of_neighbour{0}, of_outsider{0};
  auto reader =
      RawReader::create(*participant, topic, type, {}, [&](std::span<const std::uint8_t> cdr, const RawInfo&) {
        ++(cdr.size() == size_of_outsiders ? of_outsider : of_neighbour);
      });
  ASSERT_TRUE(reader) << reader.error().message;

  ASSERT_TRUE(start_sayer(outsider, street.pid(), "10.88.1.1", size_of_outsiders));
  // A participant that is heard once is answered, and then announces its topics.
  EXPECT_TRUE(eventually([&] { return dropped() > 0 || of_outsider > 0; })) << "the outsider says nothing";
  EXPECT_GT(dropped(), 0U);
  ASSERT_TRUE(start_sayer(neighbour, ::getpid(), "127.0.0.1", size_of_neighbours));
  EXPECT_TRUE(eventually([&] { return of_neighbour > 20; })) << "the neighbour is not heard";
  EXPECT_EQ(of_outsider, 0);
  EXPECT_EQ(reader->writers(), 1);
}

}  // namespace
}  // namespace ledgerline::dds
