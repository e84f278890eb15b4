#include "hil/netem/recording/capture.hpp"

#include <gmock/gmock.h>

#include <fstream>

#include "common/base/file.hpp"
#include "common/base/random.hpp"
#include "hil/netem/emulated_link.hpp"
#include "hil/netem/recording/link_recording.hpp"
#include "tests/unit/hil/netem/recording/captures.hpp"

namespace ledgerline::hil {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string error_of(const std::string& path) {
  const auto links = read_capture(path);
  return links ? std::string() : links.error().message;
}

TEST(Capture, KnowsStatesCommandsAndAnswersOfADrone) {
  const TemporaryFile file("talk.pcap");
  write_capture(file.path, {said_at(0, "command"),
                            answer_at(12 * ms, "ok"),
                            state_at(100 * ms),
                            said_at(150 * ms, "rc 0 0 0 0"),
                            state_at(200 * ms),
                            said_at(250 * ms, "takeoff"),
                            said_at(300 * ms, "battery?"),
                            answer_at(320 * ms, "87"),
                            answer_at(5'000 * ms, "ok"),
                            said_at(6'000 * ms, "speed?"),
                            {7'000 * ms, "10.0.0.1", "10.0.0.2", 53, 53, "something else"}});
  const auto links = read_capture(file.path);
  ASSERT_TRUE(links.ok()) << links.error().message;
  ASSERT_EQ(links->size(), 1U);
  const CapturedLink& link = links->front();
  EXPECT_EQ(link.drone, drone_address);
  EXPECT_THAT(link.states, ElementsAre(100 * ms, 200 * ms));
  ASSERT_EQ(link.asked.size(), 3U) << "what is answered at its end says nothing about the link";
  EXPECT_EQ(link.asked[0].answered_ns, 12 * ms);
  EXPECT_EQ(link.asked[1].answered_ns, 320 * ms);
  EXPECT_EQ(link.asked[2].answered_ns, std::nullopt);
}

TEST(Capture, WhatWasCapturedTwiceCountsOnce) {
  const TemporaryFile file("twice.pcap");
  write_capture(file.path, {state_at(0, "a", 7), state_at(1 * ms, "a", 7), state_at(100 * ms, "a", 8),
                            state_at(200 * ms, "b", 8)});
  const auto links = read_capture(file.path);
  ASSERT_TRUE(links.ok()) << links.error().message;
  EXPECT_THAT(links->front().states, ElementsAre(0, 100 * ms, 200 * ms));
}

TEST(Capture, CommandsAndAnswersThatWereCapturedTwiceCountOnce) {
  const TemporaryFile file("twice_said.pcap");
  write_capture(file.path,
                {said_at(0, "battery?", 7), answer_at(1 * ms, "87", 7), said_at(2 * ms, "battery?", 7),
                 answer_at(3 * ms, "87", 7), said_at(100 * ms, "battery?", 8), said_at(101 * ms, "speed?", 8),
                 said_at(102 * ms, "speed?", 8), answer_at(110 * ms, "86", 9), answer_at(111 * ms, "86", 9),
                 answer_at(120 * ms, "10", 10), state_at(200 * ms)});
  const auto links = read_capture(file.path);
  ASSERT_TRUE(links.ok()) << links.error().message;
  const std::vector<RequestTime>& asked = links->front().asked;
  ASSERT_EQ(asked.size(), 3U);
  EXPECT_EQ(asked[0].answered_ns, 1 * ms);
  EXPECT_EQ(asked[1].answered_ns, 110 * ms);
  EXPECT_EQ(asked[2].answered_ns, 120 * ms);
}

TEST(Capture, OfSeveralDronesOneIsNamed) {
  const TemporaryFile file("several.pcap");
  Packet other = state_at(10 * ms);
  other.from = "192.168.10.9";
  write_capture(file.path, {state_at(0), other, state_at(100 * ms)});
  const auto links = read_capture(file.path);
  ASSERT_TRUE(links.ok()) << links.error().message;
  EXPECT_EQ(link_of(*links, drone_address)->states.size(), 2U);
  EXPECT_THAT(link_of(*links, "").error().message, HasSubstr("192.168.10.9 (1 states)"));
  EXPECT_THAT(link_of(*links, "10.0.0.1").error().message, HasSubstr("no drone 10.0.0.1"));
  EXPECT_THAT(read_link_recording(file.path).error().message, HasSubstr("which drone is meant?"));
}

TEST(Capture, ReplayedByAnEmulatedLinkItHasTheSameLossesAndDelays) {
  const TemporaryFile file("day.pcap");
  Random random(11);
  std::vector<Packet> packets;
  std::vector<std::optional<TimeNs>> delays;  // beyond the least one
  std::vector<TimeNs> said;
  for (int i = 0; i < 900; ++i) {
    said.push_back(3'217 * ms + static_cast<TimeNs>(i) * 100'004 * ns_per_us);
    const int of_stall = i % 90;  // in each of them five come late, together
    TimeNs late = static_cast<TimeNs>(random.uniform() * 40) * ms;
    if (random.next() % 3 != 0) late = 0;
    if (of_stall < 5 && i >= 90) late = (5 - of_stall) * 100'004 * ns_per_us;
    const bool lost = of_stall > 10 && of_stall < 80 && random.next() % 10 == 0;
    delays.push_back(lost ? std::nullopt : std::optional(late));
    if (!lost) packets.push_back(state_at(said.back() + 2 * ms + late));
  }
  std::stable_sort(packets.begin(), packets.end(), [](const Packet& a, const Packet& b) { return a.at < b.at; });
  write_capture(file.path, packets);

  EmulatedLink link(EmulatedLink::Kind::datagrams, 1);
  Impairment impairment;
  const auto applied = apply_effects("recorded-day " + file.path, impairment);
  ASSERT_TRUE(applied.ok()) << applied.error().message;
  ASSERT_TRUE(link.set(impairment));
  std::vector<std::optional<TimeNs>> came(said.size());
  const auto take_until = [&](TimeNs now) {
    for (auto due = link.next_due(); due && *due <= now; due = link.next_due()) {
      const auto unit = link.pop(*due);
      came[unit->tag] = *due;
    }
  };
  for (std::size_t i = 0; i < said.size(); ++i) {
    take_until(said[i]);
    link.push(said[i], "state", i);
  }
  take_until(said.back() + 60 * ns_per_s);
  int lost = 0;
  for (std::size_t i = 0; i < said.size(); ++i) {
    ASSERT_EQ(came[i].has_value(), delays[i].has_value()) << i;
    if (!came[i]) ++lost;
    if (came[i]) {
      EXPECT_NEAR(to_ms(*came[i] - said[i]), to_ms(*delays[i]), 1) << i;
    }
  }
  EXPECT_GT(lost, 40);
}

TEST(Capture, ATableOfItGivesTheSameDay) {
  const TemporaryFile file("table.pcap"), table("table.csv");
  std::vector<Packet> packets;
  for (int i = 0; i < 100; ++i) {
    if (i % 7 != 3) packets.push_back(state_at(i * 100 * ms + (i % 5) * ms));
  }
  write_capture(file.path, packets);
  const auto text = table_of_capture(file.path, {});
  ASSERT_TRUE(text.ok()) << text.error().message;
  EXPECT_THAT(*text, HasSubstr("# states of 192.168.10.1: 86 came, 14 missing, one every 100.0"));
  ASSERT_TRUE(write_file(table.path, *text));
  const auto direct = read_link_recording(file.path), by_table = read_link_recording(table.path);
  ASSERT_TRUE(direct.ok() && by_table.ok());
  ASSERT_EQ((*direct)->moments().size(), (*by_table)->moments().size());
  for (std::size_t i = 0; i < (*direct)->moments().size(); ++i) {
    EXPECT_EQ((*direct)->moments()[i].lost, (*by_table)->moments()[i].lost);
    EXPECT_NEAR(to_ms((*direct)->moments()[i].delay_ns), to_ms((*by_table)->moments()[i].delay_ns), 0.002);
  }
  EXPECT_THAT(table_of_capture(file.path, {"", true}).error().message, HasSubstr("answered at once"));
}

TEST(Capture, ReadsOtherLinkTypes) {
  const Packet packet = state_at(0);
  std::string cooked(14, '\0'), cooked2, loopback(4, '\2'), vlan(12, '\0');
  cooked += std::string("\x08\x00", 2);
  cooked2 = std::string("\x08\x00", 2) + std::string(18, '\0');
  vlan += std::string("\x81\x00\x00\x05\x08\x00", 6);
  const std::tuple<int, std::string> kinds[] = {
      {DLT_LINUX_SLL, cooked}, {DLT_LINUX_SLL2, cooked2}, {DLT_NULL, loopback}, {DLT_RAW, ""}, {DLT_EN10MB, vlan}};
  for (const auto& [link_type, header] : kinds) {
    const TemporaryFile file("kind.pcap");
    write_frames(file.path, link_type, {{0, header + ip_packet(packet)}, {100 * ms, header + ip_packet(packet)}});
    const auto links = read_capture(file.path);
    ASSERT_TRUE(links.ok()) << link_type << ": " << links.error().message;
    EXPECT_EQ(links->front().states.size(), 2U) << link_type;
  }
  const TemporaryFile file("kind.pcap");
  write_frames(file.path, DLT_IEEE802_11_RADIO, {{0, std::string(100, '\0')}});
  EXPECT_THAT(error_of(file.path), HasSubstr("IEEE802_11_RADIO"));
}

TEST(Capture, ReadsPcapng) {
  const auto word = [](std::uint32_t value) {
    return std::string(reinterpret_cast<const char*>(&value), sizeof value);
  };
  const auto block = [&](std::uint32_t type, std::string body) {
    body.resize((body.size() + 3) / 4 * 4);
    const auto length = static_cast<std::uint32_t>(body.size() + 12);
    return word(type) + word(length) + body + word(length);
  };
  const std::string frame = ethernet_frame(state_at(0));
  const auto packet = [&](std::uint64_t us) {
    const auto size = static_cast<std::uint32_t>(frame.size());
    return block(6, word(0) + word(static_cast<std::uint32_t>(us >> 32)) + word(static_cast<std::uint32_t>(us)) +
                        word(size) + word(size) + frame);
  };
  constexpr std::uint64_t some_day_us = 1'790'000'000'000'000;
  const TemporaryFile file("ng.pcapng");
  ASSERT_TRUE(write_file(file.path, block(0x0a0d0d0a, word(0x1a2b3c4d) + word(1) + word(~0U) + word(~0U)) +
                                        block(1, word(DLT_EN10MB) + word(65'535)) + packet(some_day_us) +
                                        packet(some_day_us + 100'000)));
  const auto day = read_link_recording(file.path);
  ASSERT_TRUE(day.ok()) << day.error().message;
  EXPECT_EQ((*day)->moments().size(), 2U);
}

TEST(Capture, RefusesWhatIsNoneOrHasNoDroneInIt) {
  const TemporaryFile file("none.pcap");
  EXPECT_THAT(error_of("/no/such/capture"), HasSubstr("/no/such/capture"));
  ASSERT_TRUE(write_file(file.path, "seconds,delay_s\n"));
  EXPECT_THAT(error_of(file.path), HasSubstr("no capture that libpcap reads"));
  write_capture(file.path, {});
  EXPECT_THAT(error_of(file.path), HasSubstr("no Tello in it"));
  write_capture(file.path, {{0, "10.0.0.1", "10.0.0.2", 53, 53, "something else"}});
  EXPECT_THAT(error_of(file.path), HasSubstr("no Tello in it"));
  write_capture(file.path, {state_at(0), state_at(49 * 3600 * ns_per_s)});
  EXPECT_THAT(error_of(file.path), HasSubstr("packet 2 is not of the same two days"));
}

TEST(Capture, TooManyHostsAreNoTellos) {
  const TemporaryFile file("hosts.pcap");
  std::vector<Packet> packets;
  for (std::size_t i = 0; i <= max_captured_drones; ++i) {
    packets.push_back(state_at(static_cast<TimeNs>(i) * ms));
    packets.back().from = "10.0.1." + std::to_string(i);
  }
  write_capture(file.path, packets);
  EXPECT_THAT(error_of(file.path), HasSubstr("no Tellos"));
  for (std::size_t i = 0; i <= max_captured_drones; ++i) {
    packets[i] = said_at(packets[i].at, "command");
    packets[i].to = "10.0.1." + std::to_string(i);
  }
  write_capture(file.path, packets);
  EXPECT_THAT(error_of(file.path), HasSubstr("no Tellos"));
  packets.back().to = packets.front().to;
  write_capture(file.path, packets);
  EXPECT_EQ(read_capture(file.path)->size(), max_captured_drones);
}

// Whatever a file is made of, reading it ends, with a day or a reason that names it.
TEST(Capture, ADamagedOneIsReadOrRefusedWithTheReason) {
  const TemporaryFile whole("whole.pcap"), damaged("damaged.pcap");
  std::vector<Packet> packets{said_at(0, "command"), answer_at(5 * ms, "ok")};
  for (int i = 0; i < 20; ++i) packets.push_back(state_at((10 + i * 100) * ms));
  write_capture(whole.path, packets);
  const auto bytes = read_file(whole.path);
  ASSERT_TRUE(bytes.ok());
  Random random(5);
  int refused = 0, read = 0;
  for (int i = 0; i < 2'000; ++i) {
    std::string changed = *bytes;
    if (i % 3 == 0) changed.resize(random.next() % changed.size());
    for (std::uint64_t k = random.next() % 8; k > 0 && !changed.empty(); --k)
      changed[random.next() % changed.size()] = static_cast<char>(random.next());
    ASSERT_TRUE(write_file(damaged.path, changed));
    const auto day = read_link_recording(damaged.path);
    if (day) {
      ++read;
    } else {
      ++refused;
      EXPECT_THAT(day.error().message, HasSubstr(damaged.path));
    }
  }
  EXPECT_GT(read, 100);
  EXPECT_GT(refused, 300);
}

TEST(CapturedDatagrams, AreNoneWhereHeadersLie) {
  const std::string good = ip_packet(state_at(0, "text"));
  ASSERT_TRUE(datagram_in(DLT_RAW, good));
  EXPECT_EQ(datagram_in(DLT_RAW, good)->payload, "text");
  for (std::size_t size = 0; size < sizeof(iphdr) + sizeof(udphdr); ++size)
    EXPECT_FALSE(datagram_in(DLT_RAW, std::string_view(good).substr(0, size))) << size;
  EXPECT_EQ(datagram_in(DLT_RAW, std::string_view(good).substr(0, good.size() - 1))->payload, "tex")
      << "cut by tcpdump -s";
  const auto changed = [&](std::size_t at, char value) {
    std::string bytes = good;
    bytes[at] = value;
    return bytes;
  };
  EXPECT_FALSE(datagram_in(DLT_RAW, changed(0, 0x65))) << "version 6";
  EXPECT_FALSE(datagram_in(DLT_RAW, changed(0, 0x44))) << "too short a header";
  EXPECT_FALSE(datagram_in(DLT_RAW, changed(0, 0x4f))) << "a header longer than the packet";
  EXPECT_FALSE(datagram_in(DLT_RAW, changed(3, 4))) << "shorter than its header";
  EXPECT_FALSE(datagram_in(DLT_RAW, changed(6, 0x20))) << "a fragment";
  EXPECT_FALSE(datagram_in(DLT_RAW, changed(9, 6))) << "TCP";
  EXPECT_FALSE(datagram_in(DLT_RAW, changed(25, 7))) << "a UDP length below its header";
  EXPECT_FALSE(datagram_in(DLT_PPP, good));
}

}  // namespace
}  // namespace ledgerline::hil
