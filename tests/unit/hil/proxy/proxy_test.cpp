#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "hil/proxy/server_side.hpp"
#include "hil/proxy/settings.hpp"
#include "hil/proxy/switches.hpp"
#include "tests/unit/no_files.hpp"

namespace ledgerline::hil::proxy {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using Kind = Target::Kind;

Switches switches() {
  return Switches(
      {{Kind::drone, "tello1"}, {Kind::drone, "tello2"}, {Kind::server, "agent"}, {Kind::server, "ground"}});
}

TEST(Switches, ChangeTheDirectionThatIsNamedAndNoOther) {
  Switches s = switches();
  ASSERT_TRUE(s.apply("drone tello1 to delay 200ms, loss 5%"));
  EXPECT_EQ(text_of(s.of(0, Direction::to)), "delay 200ms, loss 5%");
  EXPECT_EQ(s.list(), "drone tello1 to delay 200ms, loss 5%\n");
  ASSERT_TRUE(s.apply("drone tello1 to loss off"));
  ASSERT_TRUE(s.apply("drone tello2 from stall"));
  ASSERT_TRUE(s.apply("server agent from delay 1s"));
  EXPECT_EQ(s.list(),
            "drone tello1 to delay 200ms\ndrone tello2 answers stall\ndrone tello2 state stall\ndrone tello2 video "
            "stall\nserver agent from delay 1s\n");
  ASSERT_TRUE(s.apply("clear"));
  EXPECT_EQ(s.list(), "");
}

TEST(Switches, MeanAllOfAKindByAStarAndBothDirectionsByBoth) {
  Switches s = switches();
  ASSERT_TRUE(s.apply("drone * answers duplicate 100%"));
  ASSERT_TRUE(s.apply("server * both partition"));
  EXPECT_EQ(s.list(),
            "drone tello1 answers duplicate 100% 0s\ndrone tello2 answers duplicate 100% 0s\nserver agent to "
            "partition\nserver agent from partition\nserver ground to partition\nserver ground from partition\n");
  ASSERT_TRUE(s.apply("drone tello1 both clear"));
  ASSERT_TRUE(s.apply("server ground both partition off"));
  EXPECT_EQ(s.list(),
            "drone tello2 answers duplicate 100% 0s\nserver agent to partition\nserver agent from partition\n");
}

TEST(Switches, CutConnectionsOnce) {
  Switches s = switches();
  ASSERT_TRUE(s.apply("server agent cut"));
  EXPECT_TRUE(s.pop_cut(2));
  EXPECT_FALSE(s.pop_cut(2));
  EXPECT_FALSE(s.pop_cut(3));
}

TEST(Switches, RefuseWhatATargetCannotHaveAndChangeNothingThen) {
  const std::pair<const char*, const char*> cases[] = {
      {"", "allowed are: drone NAME"},
      {"tello1 to delay 1s", "allowed are: drone NAME"},
      {"drone tello1", "allowed are: drone NAME"},
      {"drone tello1 to", "an effect is missing"},
      {"drone tello9 to delay 1s", "there is no such drone; there are tello1, tello2"},
      {"server tello1 to delay 1s", "there is no such server; there are agent, ground"},
      {"drone tello1 sideways delay 1s", "a drone has to, answers, state, video"},
      {"server agent answers delay 1s", "a server has to, from, both and cut"},
      {"drone tello1 to lag 1s", "allowed are delay, jitter"},
      {"server agent to loss 5%", "loss is of datagrams"},
      {"server * both delay 1s, corrupt 1%", "corrupt is of datagrams"},
      {"server agent from duplicate 1%", "duplicate is of datagrams"},
      {"drone tello1 cut", "a drone has no connection that could be cut"},
      {"server agent cut now", "a server has"},
      {"clear all", "allowed are: drone NAME"},
  };
  for (const auto& [command, why] : cases) {
    Switches s = switches();
    ASSERT_TRUE(s.apply("drone tello1 to delay 7ms"));
    const auto applied = s.apply(command);
    ASSERT_FALSE(applied) << command;
    EXPECT_THAT(applied.error().message, AllOf(HasSubstr(why), HasSubstr(command))) << command;
    EXPECT_EQ(s.list(), "drone tello1 to delay 7ms\n") << command;
  }
}

std::vector<std::pair<TimeNs, std::string>> all_of(CommandSchedule& schedule) {
  std::vector<std::pair<TimeNs, std::string>> out;
  while (const auto next = schedule.next()) {
    EXPECT_FALSE(schedule.pop(*next - 1));
    out.emplace_back(*next, *schedule.pop(*next));
  }
  return out;
}

TEST(CommandSchedule, SwitchesInTheOrderOfTimeAndOffAgainAfterAWhile) {
  const std::vector<ScheduledFault> faults{
      {2 * ns_per_s, 3 * ns_per_s, "drone tello1 to delay 200ms, loss bursts 1% 20%"},
      {ns_per_s, std::nullopt, "server agent cut"},
      {4 * ns_per_s, ns_per_s, "server * both stall"},
  };
  auto schedule = CommandSchedule::make(faults, switches());
  ASSERT_TRUE(schedule) << schedule.error().message;
  using testing::ElementsAre;
  using testing::Pair;
  EXPECT_THAT(all_of(*schedule), ElementsAre(Pair(ns_per_s, "server agent cut"),
                                             Pair(2 * ns_per_s, "drone tello1 to delay 200ms, loss bursts 1% 20%"),
                                             Pair(4 * ns_per_s, "server * both stall"),
                                             Pair(5 * ns_per_s, "drone tello1 to delay off, loss off"),
                                             Pair(5 * ns_per_s, "server * both stall off")));
  Switches s = switches();
  ASSERT_TRUE(s.apply(faults[0].command));
  ASSERT_TRUE(s.apply(*opposite(faults[0].command)));
  EXPECT_EQ(s.list(), "");
}

TEST(Switches, SensorsAreOneMoreAndOneLess) {
  Switches s = switches();
  ASSERT_TRUE(s.apply("sensor tello1 bat bias -5"));
  ASSERT_TRUE(s.apply("sensor *  bat bias  -5"));
  EXPECT_EQ(s.list(), "sensor tello1 bat bias -5\nsensor tello1 bat bias -5\nsensor tello2 bat bias -5\n");
  ASSERT_TRUE(s.apply(*opposite("sensor tello1 bat bias -5")));
  EXPECT_EQ(s.list(), "sensor tello1 bat bias -5\nsensor tello2 bat bias -5\n");
  EXPECT_NE(s.sensors(0)[0].item, s.sensors(1)[0].item);
  EXPECT_THAT(s.apply("sensor tello3 h stuck").error().message, HasSubstr("there is no such drone"));
  EXPECT_THAT(s.apply("sensor tello1 speed stuck").error().message, HasSubstr("must be `FIELD|all stuck|garbage`"));
  for (std::size_t i = 1; i < Switches::max_faults; ++i) ASSERT_TRUE(s.apply("sensor tello1 all garbage"));
  EXPECT_THAT(s.apply("sensor * h stuck").error().message, HasSubstr("tello1 has 16 such faults already"));
  EXPECT_EQ(s.sensors(1).size(), 1U) << "a command that is refused for one changes none";
  ASSERT_TRUE(s.apply("clear"));
  EXPECT_EQ(s.list(), "");
}

TEST(Switches, FaultsAtTheSdksCallsNeedTheShim) {
  const std::vector<Target> one{{Kind::drone, "tello1", true}},
      two{{Kind::drone, "tello1", true}, {Kind::drone, "tello2", true}};
  EXPECT_THAT(Switches({{Kind::drone, "tello1"}}).apply("sdk tello1 answers late 300ms").error().message,
              HasSubstr("only the shim knows"));
  Switches s(two);
  ASSERT_TRUE(s.apply("sdk * answers late  300ms to takeoff"));
  ASSERT_TRUE(s.apply("sdk tello2 states other 30%"));
  EXPECT_EQ(
      s.list(),
      "sdk tello1 answers late 300ms to takeoff\nsdk tello2 answers late 300ms to takeoff\nsdk tello2 states other "
      "30%\n");
  ASSERT_EQ(s.sdk(1).size(), 2U);
  EXPECT_EQ(s.sdk(1)[0].time_ns, 300 * ns_per_ms);
  EXPECT_NE(s.sdk(1)[0].item, s.sdk(1)[1].item);
  ASSERT_TRUE(s.apply(*opposite("sdk tello2 states other 30%")));
  EXPECT_EQ(s.sdk(1).size(), 1U);
  EXPECT_THAT(s.apply("sdk tello1 answers lost").error().message, HasSubstr("must be `answers late TIME"));
  EXPECT_THAT(s.apply("sdk tello9 states torn").error().message, HasSubstr("there are tello1, tello2"));
  ASSERT_TRUE(s.apply("clear"));
  EXPECT_EQ(s.list(), "");
  Switches alone(one);
  EXPECT_THAT(alone.apply("sdk tello1 states other").error().message, HasSubstr("no other drone"));
}

TEST(CommandSchedule, ReadsARecordingOnce) {
  int reads = 0;
  Switches s({{Kind::drone, "tello1"}}, reading_once<Distribution::Recording>([&](const std::string& path) {
               ++reads;
               return parse_recording(path, "0.01");
             }));
  const auto schedule = CommandSchedule::make({{0, ns_per_s, "drone tello1 to delay recorded f"}}, s);
  ASSERT_TRUE(schedule) << schedule.error().message;
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(s.apply("drone tello1 to delay recorded f"));
  EXPECT_EQ(reads, 1);
}

TEST(CommandSchedule, ReadsARecordedDayOnce) {
  int reads = 0;
  Switches s({{Kind::drone, "tello1"}, {Kind::server, "agent"}}, reading_once<Distribution::Recording>(read_recording),
             reading_once<std::shared_ptr<const LinkRecording>>([&](const std::string& path) {
               ++reads;
               return parse_link_recording(path, path == "lossless" ? "0,0.01\n1,0.02\n" : "0,0.01\n1,lost\n");
             }));
  const auto schedule = CommandSchedule::make({{0, ns_per_s, "drone tello1 state recorded-day f at 1s"}}, s);
  ASSERT_TRUE(schedule) << schedule.error().message;
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(s.apply("drone tello1 state recorded-day f at 1s"));
  EXPECT_EQ(reads, 1);
  EXPECT_EQ(s.list(), "drone tello1 state recorded-day f at 1s\n");
  ASSERT_TRUE(s.apply(*opposite("drone tello1 state recorded-day f at 1s")));
  EXPECT_EQ(s.list(), "");
  EXPECT_THAT(s.apply("server agent both recorded-day f").error().message, HasSubstr("a recorded day with losses"));
  EXPECT_TRUE(s.apply("server agent both recorded-day lossless"));
}

TEST(CommandSchedule, RefusesWhoseEndWouldEndAnother) {
  const auto error_of = [](std::vector<ScheduledFault> faults) {
    const auto schedule = CommandSchedule::make(faults, switches());
    return schedule ? "" : schedule.error().message;
  };
  constexpr TimeNs s = ns_per_s;
  const char* why = "and the end of one would end both";
  // Of two that last: they overlap, whichever is first in the file.
  EXPECT_THAT(error_of({{1 * s, 5 * s, "drone tello1 to delay 1s"}, {3 * s, s, "drone tello1 to delay 2s"}}),
              HasSubstr(why));
  EXPECT_THAT(error_of({{3 * s, s, "drone tello1 to loss 5%"}, {1 * s, 5 * s, "drone * both loss 9%"}}),
              AllOf(HasSubstr("tello1 to has such an effect"), HasSubstr(why)));
  // One that stays, and one that ends upon it.
  EXPECT_THAT(error_of({{1 * s, {}, "server agent to stall"}, {3 * s, s, "server * both stall"}}), HasSubstr(why));
  EXPECT_THAT(error_of({{1 * s, 5 * s, "server agent to delay 1s"}, {3 * s, {}, "server agent to delay 2s"}}),
              HasSubstr(why));
  // One behind the other, other effects, other directions, a change of what stays.
  EXPECT_EQ(error_of({{3 * s, s, "drone tello1 to delay 2s"}, {1 * s, 2 * s, "drone tello1 to delay 1s"}}), "");
  EXPECT_EQ(error_of({{1 * s, 5 * s, "drone tello1 to delay 1s"}, {3 * s, s, "drone tello1 to loss 2%"}}), "");
  EXPECT_EQ(error_of({{1 * s, 5 * s, "drone tello1 to delay 1s"}, {3 * s, s, "drone tello1 from delay 1s"}}), "");
  EXPECT_EQ(error_of({{1 * s, {}, "drone tello1 to delay 1s"}, {3 * s, {}, "drone tello1 to delay 2s"}}), "");
  EXPECT_EQ(
      error_of({{1 * s, 9 * s, "drone tello1 to delay 1s"}, {2 * s, {}, "clear"}, {3 * s, s, "drone * to delay 2s"}}),
      "");
}

TEST(CommandSchedule, RefusesAtOnceWhatCouldNotBeSwitchedLater) {
  const auto error_of = [](ScheduledFault fault) {
    const auto schedule = CommandSchedule::make({fault}, switches());
    return schedule ? "no error" : schedule.error().message;
  };
  EXPECT_THAT(error_of({ns_per_s, {}, "server agent to loss 5%"}), HasSubstr("loss is of datagrams"));
  EXPECT_THAT(error_of({ns_per_s, ns_per_s, "server agent cut"}), HasSubstr("only effects last for a time"));
  EXPECT_THAT(error_of({ns_per_s, ns_per_s, "clear"}), HasSubstr("only effects last for a time"));
  EXPECT_THAT(error_of({ns_per_s, ns_per_s, "drone tello1 to loss off"}), HasSubstr("only what is switched on"));
}

/// A folder of its own, gone afterwards.
class Folder : public testing::Test {
 protected:
  Folder() {
    char name[] = "/tmp/ledgerline-proxy-XXXXXX";
    path_ = ::mkdtemp(name);
  }
  ~Folder() override {
    for (const std::string& file : files_) ::unlink(in(file).c_str());
    ::rmdir(path_.c_str());
  }
  std::string in(const std::string& name) const { return path_ + "/" + name; }
  std::string write(const std::string& name, const std::string& text) {
    files_.push_back(name);
    std::ofstream(in(name)) << text;
    return in(name);
  }

  std::string path_;
  std::vector<std::string> files_;
};

using ProxySettings = Folder;

const char* const good = R"(
[proxy]
seed = 7
faults = "f.sock"
source = "127.0.2.1"
[[drone]]
name = "tello1"
listen = "127.0.1.2"
address = "127.0.0.2"
[[server]]
name = "agent"
listen = "127.0.0.1:0"
address = "127.0.0.1:7051"
)";

TEST_F(ProxySettings, AreReadFromConfigAndScript) {
  const auto settings = read_settings(write("proxy.toml", good), write("script.toml", R"(
[[fault]]
at_s = 2.5
for_s = 1
do = "drone tello1 to delay 200ms"
)"));
  ASSERT_TRUE(settings) << settings.error().message;
  EXPECT_EQ(settings->seed, 7u);
  EXPECT_EQ(settings->faults_socket, "f.sock");
  ASSERT_EQ(settings->drones.size(), 1u);
  EXPECT_EQ(ntohl(settings->drones[0].listen.s_addr), 0x7F000102u);
  EXPECT_EQ(ntohl(settings->source.s_addr), 0x7F000201u);
  ASSERT_EQ(settings->servers.size(), 1u);
  EXPECT_EQ(address_text(settings->servers[0].address), "127.0.0.1:7051");
  ASSERT_EQ(settings->faults.size(), 1u);
  EXPECT_EQ(settings->faults[0].at_ns, 2'500 * ns_per_ms);
  EXPECT_EQ(settings->faults[0].for_ns, ns_per_s);
}

TEST_F(ProxySettings, NameFileAndKeyOfWhatIsWrong) {
  const auto error_of = [&](std::string from, const std::string& to, const std::string& script = {}) {
    std::string text = good;
    if (!from.empty()) text.replace(text.find(from), from.size(), to);
    const auto settings = read_settings(write("proxy.toml", text), script.empty() ? "" : write("script.toml", script));
    return settings ? "no error" : settings.error().message;
  };
  EXPECT_EQ(error_of("", ""), "no error");
  EXPECT_THAT(error_of("127.0.1.2", "here"), HasSubstr("drone.0.listen: must be an IPv4 address"));
  EXPECT_THAT(error_of("127.0.0.1:7051", "127.0.0.1"),
              HasSubstr("server.0.address: must be an IPv4 address and a port"));
  EXPECT_THAT(error_of("127.0.0.1:7051", "127.0.0.1:0"), HasSubstr("server.0.address: must be"));
  EXPECT_THAT(error_of("127.0.0.1:7051", "127.0.0.1:70510"), HasSubstr("server.0.address: must be"));
  EXPECT_THAT(error_of("\"tello1\"", "\"*\""), HasSubstr("drone.0.name: must be one word"));
  EXPECT_THAT(error_of("\"tello1\"", "\"tello 1\""), HasSubstr("drone.0.name: must be one word"));
  EXPECT_THAT(error_of("seed = 7", "sed = 7"), HasSubstr("proxy.sed: unknown key"));
  EXPECT_THAT(
      error_of("[[server]]", "[[drone]]\nname=\"tello1\"\nlisten=\"127.0.1.3\"\naddress=\"127.0.0.3\"\n[[server]]"),
      HasSubstr("drone.1.name: must be a name that no other has"));
  EXPECT_THAT(error_of("", "", "[[fault]]\nat_s = 1\ndo = \"server agent to loss 5%\"\n"),
              AllOf(HasSubstr("script.toml:3: fault.0.do"), HasSubstr("loss is of datagrams")));
  EXPECT_THAT(error_of("", "",
                       "[[fault]]\nat_s = 1\nfor_s = 9\ndo = \"server agent to stall\"\n"
                       "[[fault]]\nat_s = 2\nfor_s = 1\ndo = \"server * both stall\"\n"),
              AllOf(HasSubstr("script.toml:8: fault.1.do"), HasSubstr("the end of one would end both")));
  EXPECT_THAT(error_of("", "", "[[fault]]\ndo = \"clear\"\n"), HasSubstr("fault.0.at_s: is missing"));
  const auto empty = read_settings(write("empty.toml", ""), "");
  EXPECT_THAT(empty.error().message, HasSubstr("what to stand before"));
}

bool readable(const pollfd& one) {
  pollfd asked = one;
  return ::poll(&asked, 1, 0) > 0;
}

int connected_to(const sockaddr_in& address) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  EXPECT_EQ(::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  return fd;
}

TEST(ServerSide, ThatMayOpenNoMoreFilesWaitsAWhileAndDoesNotSpin) {
  ServerRoute route{"node", {}, {}};
  route.listen.sin_family = route.address.sin_family = AF_INET;
  route.listen.sin_addr.s_addr = route.address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  route.address.sin_port = htons(9);
  auto side = ServerSide::open(route, 1);
  ASSERT_TRUE(side) << side.error().message;
  const int client = connected_to(side->listening());
  const TimeNs now = 5 * ns_per_s;
  std::vector<pollfd> polled;
  {
    const NoFiles none;
    side->add_to(now, polled);
    ASSERT_TRUE(readable(polled[0]));
    polled[0].revents = POLLIN;
    side->serve(now, polled);
  }
  polled.clear();
  side->add_to(now + ns_per_ms, polled);
  EXPECT_EQ(polled[0].fd, -1);
  EXPECT_EQ(side->next_due(now + ns_per_ms), now + ServerSide::accept_pause);
  EXPECT_EQ(side->summary()["not_taken"], 1);
  polled.clear();
  side->add_to(now + ServerSide::accept_pause, polled);
  ASSERT_TRUE(readable(polled[0]));
  polled[0].revents = POLLIN;
  side->serve(now + ServerSide::accept_pause, polled);
  EXPECT_EQ(side->summary()["connections"], 1);
  ::close(client);
}

}  // namespace
}  // namespace ledgerline::hil::proxy
