#include "onboard/link/shell/transport/tello_sockets.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <string>
#include <thread>
#include <vector>

namespace ledgerline::link {
namespace {

sockaddr_in at(const char* host, std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  ::inet_pton(AF_INET, host, &address.sin_addr);
  return address;
}

/// Somebody who speaks UDP from an address of his own.
class Speaker {
 public:
  explicit Speaker(const char* host, std::uint16_t port = 0) : socket_(std::move(*open_udp(""))) {
    EXPECT_TRUE(listen_alone(socket_, at(host, port)));
  }
  sockaddr_in place() const {
    sockaddr_in own{};
    socklen_t size = sizeof own;
    ::getsockname(socket_.get(), reinterpret_cast<sockaddr*>(&own), &size);
    return own;
  }
  void say(const sockaddr_in& to, const std::string& text) const {
    EXPECT_EQ(::sendto(socket_.get(), text.data(), text.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to),
              static_cast<ssize_t>(text.size()));
  }
  /// What came, and from where.
  std::string hear(sockaddr_in& from) const {
    std::array<char, 256> buffer{};
    socklen_t size = sizeof from;
    const ssize_t n =
        ::recvfrom(socket_.get(), buffer.data(), buffer.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
    return n < 0 ? "" : std::string(buffer.data(), static_cast<std::size_t>(n));
  }

 private:
  Descriptor socket_;
};

/// Two drones at loopback addresses, tello1 with number 3.
class Sockets : public ::testing::Test {
 protected:
  Sockets() : tello1("127.0.0.2"), tello2("127.0.0.3", ntohs(tello1.place().sin_port)) {
    settings.link.drones = {{.name = "tello1", .number = 3}, {.name = "tello2", .number = 4}};
    settings.addresses = {tello1.place(), tello2.place()};
    settings.interfaces = {"", ""};
    settings.state_port = ntohs(tello1.place().sin_port);
    {
      const Speaker free("127.0.0.1");
      settings.state_listen = free.place();
    }
    auto created = TelloSockets::create(settings);
    EXPECT_TRUE(created) << created.error().message;
    sockets = std::make_unique<TelloSockets>(std::move(*created));
  }
  /// Sends a command, and says where it came from.
  sockaddr_in command(DroneNumber number, const Speaker& drone, const std::string& word = "command") {
    EXPECT_TRUE(sockets->send({number, CommandText(word)}));
    sockaddr_in from{};
    EXPECT_EQ(drone.hear(from), word);
    return from;
  }
  std::vector<std::string> received() {
    std::vector<std::string> all;
    for (const Received& one : sockets->receive()) {
      all.push_back(std::to_string(one.drone) + (one.port == Port::answer ? " answers " : " states ") +
                    std::string(one.bytes));
    }
    return all;
  }

  using Texts = std::vector<std::string>;
  Speaker tello1, tello2;
  ShellSettings settings;
  std::unique_ptr<TelloSockets> sockets;
};

TEST_F(Sockets, EachDroneIsSpokenToFromASocketOfItsOwnAndIsHeardByIt) {
  const sockaddr_in first = command(3, tello1), second = command(4, tello2);
  EXPECT_NE(first.sin_port, second.sin_port);
  tello1.say(first, "ok");
  tello2.say(second, "error");
  EXPECT_EQ(received(), (Texts{"3 answers ok", "4 answers error"}));
  EXPECT_FALSE(sockets->send({9, CommandText("command")}));
}

TEST_F(Sockets, TheFirstZeroReachesEachDroneAndAlsoThoseBesideOneWhoseInterfaceIsGone) {
  sockaddr_in from{};
  sockets->send_first_zero();
  for (const Speaker* drone : {&tello1, &tello2}) {
    EXPECT_EQ(drone->hear(from), "command");
    EXPECT_EQ(drone->hear(from), "rc 0 0 0 0");
  }
  sockets.reset();
  settings.interfaces[0] = "nosuch0";
  EXPECT_FALSE(TelloSockets::create(settings));
  EXPECT_EQ(tello2.hear(from), "command");
  EXPECT_EQ(tello2.hear(from), "rc 0 0 0 0");
}

TEST_F(Sockets, SayWhenTheDeviceHadWhatWasSentOnceEachAndOnlyWhereThereIsATrace) {
  if (!stamp_sends(*open_udp(""))) GTEST_SKIP() << "qemu-user has no SO_TIMESTAMPING";
  command(3, tello1);
  EXPECT_TRUE(sockets->at_device().empty());
  sockets.reset();
  settings.trace = "a file";
  sockets = std::make_unique<TelloSockets>(std::move(*TelloSockets::create(settings)));
  for (int i = 0; i < 3; ++i) {
    const TimeNs before = monotonic_ns();
    command(3, tello1, "rc 0 0 0 1");
    command(3, tello1, "rc 0 0 0 2");  // of two the newer one counts
    const auto at = sockets->at_device();
    ASSERT_EQ(at.size(), 1U);
    EXPECT_EQ(at[0].drone, 3);
    EXPECT_GE(at[0].t_ns, before);
    EXPECT_LE(at[0].t_ns, monotonic_ns() + ns_per_ms) << "two clocks are read one after the other";
    EXPECT_TRUE(sockets->at_device().empty());
  }
  tello1.say(command(3, tello1), "ok");
  EXPECT_EQ(received(), (Texts{"3 answers ok"})) << "what is not read of stamps keeps no answer back";
}

TEST_F(Sockets, AnAnswerThatTheDroneDidNotSendFromItsCommandPortIsDropped) {
  const sockaddr_in link = command(3, tello1);
  tello2.say(link, "ok");                 // another drone
  Speaker("127.0.0.2").say(link, "ok");   // the drone's address, another port
  Speaker("127.0.0.77").say(link, "ok");  // nobody's
  EXPECT_EQ(received(), Texts{});
  tello1.say(link, "ok");
  EXPECT_EQ(received(), (Texts{"3 answers ok"}));
}

TEST_F(Sockets, StateTextIsTakenFromTheDronesAddressAndStatePortAlone) {
  const sockaddr_in& to = settings.state_listen;
  tello1.say(to, "h:1;");
  tello2.say(to, "h:2;");
  Speaker("127.0.0.2").say(to, "h:3;");
  Speaker("127.0.0.77", settings.state_port).say(to, "h:4;");
  EXPECT_EQ(received(), (Texts{"3 states h:1;", "4 states h:2;"}));

  const auto news = sockets->refresh();
  ASSERT_EQ(news.size(), 1U);
  EXPECT_NE(news[0].find("tello1"), std::string::npos) << news[0];
  EXPECT_NE(news[0].find("state_port"), std::string::npos) << news[0];
  EXPECT_TRUE(sockets->refresh().empty());  // said once
}

// Of sockets that share a port the kernel gives the datagrams to one, which may be any user's.
TEST_F(Sockets, ThePortOfTheStateTextsIsSharedWithNobodyWhateverInterfacesThereAre) {
  const auto takes_it = [&](const char* host) {
    const Descriptor thief(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
    const int on = 1;
    ::setsockopt(thief.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    const sockaddr_in place = at(host, ntohs(settings.state_listen.sin_port));
    return ::bind(thief.get(), reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0;
  };
  EXPECT_FALSE(takes_it("127.0.0.1"));
  EXPECT_FALSE(takes_it("0.0.0.0"));
  for (const std::vector<std::string>& interfaces : {std::vector<std::string>{"lo", ""}, {"", "lo"}}) {
    sockets.reset();
    settings.interfaces = interfaces;
    auto created = TelloSockets::create(settings);
    ASSERT_TRUE(created) << created.error().message;
    sockets = std::make_unique<TelloSockets>(std::move(*created));
    (void)sockets->refresh();
    EXPECT_FALSE(takes_it("127.0.0.1"));
    EXPECT_FALSE(takes_it("0.0.0.0"));
  }
}

TEST_F(Sockets, ASharedPortThatAnotherProgramHasAlreadyIsRefused) {
  sockets.reset();
  const Descriptor thief(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const int on = 1;
  ::setsockopt(thief.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  ASSERT_EQ(
      ::bind(thief.get(), reinterpret_cast<const sockaddr*>(&settings.state_listen), sizeof settings.state_listen), 0);
  EXPECT_FALSE(TelloSockets::create(settings));
}

TEST_F(Sockets, WithStatePortZeroAnyPortOfTheDronesAddressWillDo) {
  settings.state_port = 0;
  sockets.reset();
  sockets = std::make_unique<TelloSockets>(std::move(*TelloSockets::create(settings)));
  Speaker("127.0.0.2").say(settings.state_listen, "h:3;");
  Speaker("127.0.0.77").say(settings.state_listen, "h:4;");
  EXPECT_EQ(received(), (Texts{"3 states h:3;"}));
}

TEST_F(Sockets, AFloodOfOneDroneNeitherFillsATurnNorStarvesTheOther) {
  const sockaddr_in first = command(3, tello1), second = command(4, tello2);
  for (int i = 0; i < 200; ++i) tello1.say(first, "ok");
  for (int i = 0; i < 200; ++i) tello1.say(settings.state_listen, "h:1;");
  tello2.say(second, "ok");
  const auto all = received();
  EXPECT_LE(all.size(), 64U);
  EXPECT_EQ(std::count(all.begin(), all.end(), "4 answers ok"), 1);
  EXPECT_EQ(std::count(all.begin(), all.end(), "3 states h:1;"), 32);
}

TEST_F(Sockets, ADroneThatWasNotThereIsReachedByTheFirstCommandOnceItIs) {
  settings.addresses[0] = at("127.0.0.9", settings.state_port);
  sockets = nullptr;
  sockets = std::make_unique<TelloSockets>(std::move(*TelloSockets::create(settings)));
  EXPECT_TRUE(sockets->send({3, CommandText("command")}));  // nobody is there, as ICMP tells now
  const Speaker late("127.0.0.9", settings.state_port);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  command(3, late);
}

TEST_F(Sockets, AnInterfaceThatIsNotThereIsAnErrorWithDroneAndInterface) {
  sockets.reset();
  settings.interfaces[1] = "wlan77";
  const auto created = TelloSockets::create(settings);
  ASSERT_FALSE(created);
  EXPECT_NE(created.error().message.find("tello2"), std::string::npos) << created.error().message;
  EXPECT_NE(created.error().message.find("wlan77"), std::string::npos) << created.error().message;
}

TEST_F(Sockets, WhatComesThroughAnInterfaceIsItsDronesOrOfOneWithoutAnInterface) {
  sockets.reset();
  settings.interfaces = {"lo", ""};
  auto created = TelloSockets::create(settings);
  ASSERT_TRUE(created) << created.error().message;
  sockets = std::make_unique<TelloSockets>(std::move(*created));
  tello1.say(settings.state_listen, "h:1;");
  tello2.say(settings.state_listen, "h:2;");  // comes through tello1's interface, and has none of its own
  EXPECT_EQ(received(), (Texts{"3 states h:1;", "4 states h:2;"}));
  command(3, tello1);
  EXPECT_TRUE(sockets->refresh().empty());
}

}  // namespace
}  // namespace ledgerline::link
