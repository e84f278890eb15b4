#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <thread>

#include "hil/proxy/fault_socket.hpp"
#include "hil/proxy/settings.hpp"
#include "hil/proxy/switches.hpp"

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
  EXPECT_EQ(text_of(s.of(0, Way::to)), "delay 200ms, loss 5%");
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
  EXPECT_TRUE(s.take_cut(2));
  EXPECT_FALSE(s.take_cut(2));
  EXPECT_FALSE(s.take_cut(3));
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
    EXPECT_THAT(applied.error().what, AllOf(HasSubstr(why), HasSubstr(command))) << command;
    EXPECT_EQ(s.list(), "drone tello1 to delay 7ms\n") << command;
  }
}

std::vector<std::pair<TimeNs, std::string>> all_of(Script& script) {
  std::vector<std::pair<TimeNs, std::string>> out;
  while (const auto next = script.next()) {
    EXPECT_FALSE(script.take(*next - 1));
    out.emplace_back(*next, *script.take(*next));
  }
  return out;
}

TEST(Script, SwitchesInTheOrderOfTimeAndOffAgainAfterAWhile) {
  const std::vector<ScriptedFault> faults{
      {2 * ns_per_s, 3 * ns_per_s, "drone tello1 to delay 200ms, loss bursts 1% 20%"},
      {ns_per_s, std::nullopt, "server agent cut"},
      {4 * ns_per_s, ns_per_s, "server * both stall"},
  };
  auto script = Script::make(faults, switches());
  ASSERT_TRUE(script) << script.error().what;
  using testing::ElementsAre;
  using testing::Pair;
  EXPECT_THAT(all_of(*script), ElementsAre(Pair(ns_per_s, "server agent cut"),
                                           Pair(2 * ns_per_s, "drone tello1 to delay 200ms, loss bursts 1% 20%"),
                                           Pair(4 * ns_per_s, "server * both stall"),
                                           Pair(5 * ns_per_s, "drone tello1 to delay off, loss off"),
                                           Pair(5 * ns_per_s, "server * both stall off")));
  Switches s = switches();
  ASSERT_TRUE(s.apply(faults[0].command));
  ASSERT_TRUE(s.apply(*opposite(faults[0].command)));
  EXPECT_EQ(s.list(), "");
}

TEST(Script, RefusesAtOnceWhatCouldNotBeSwitchedLater) {
  const auto error_of = [](ScriptedFault fault) {
    const auto script = Script::make({fault}, switches());
    return script ? "no error" : script.error().what;
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
  ASSERT_TRUE(settings) << settings.error().what;
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
    return settings ? "no error" : settings.error().what;
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
  EXPECT_THAT(error_of("", "", "[[fault]]\ndo = \"clear\"\n"), HasSubstr("fault.0.at_s: is missing"));
  const auto empty = read_settings(write("empty.toml", ""), "");
  EXPECT_THAT(empty.error().what, HasSubstr("what to stand before"));
}

/// Serves a socket until it goes.
class Served {
 public:
  Served(FaultSocket socket, FaultSocket::Do act)
      : socket_(std::move(socket)), act_(std::move(act)), thread_([this] { serve(); }) {}
  ~Served() {
    end_ = true;
    thread_.join();
  }

 private:
  void serve() {
    while (!end_) {
      std::vector<pollfd> polled;
      socket_.add_to(polled);
      ::poll(polled.data(), polled.size(), 5);
      socket_.serve(monotonic_ns(), polled, act_);
    }
  }
  FaultSocket socket_;
  FaultSocket::Do act_;
  std::atomic<bool> end_{false};
  std::thread thread_;
};

using Socket = Folder;

TEST_F(Socket, CarriesACommandAndItsAnswerOrError) {
  const std::string path = in("f.sock");
  auto socket = FaultSocket::open(path);
  ASSERT_TRUE(socket) << socket.error().what;
  struct stat mode {};
  ASSERT_EQ(::stat(path.c_str(), &mode), 0);
  EXPECT_EQ(mode.st_mode & 0777, 0600u);
  EXPECT_THAT(FaultSocket::open(path).error().what, HasSubstr("another program's"));
  {
    const Served served(std::move(*socket), [](const std::string& command) -> Result<std::string> {
      if (command == "bad") return Error{"no such thing"};
      return command == "list" ? std::string("one\ntwo\n") : std::string();
    });
    for (int i = 0; i < 20; ++i) EXPECT_EQ(*tell(path, "list"), "one\ntwo\n");
    EXPECT_EQ(*tell(path, "do"), "");
    EXPECT_EQ(tell(path, "bad").error().what, "no such thing");
    EXPECT_THAT(tell(path, std::string(1'000, 'x')).error().what, HasSubstr("less than 1000 bytes"));
    EXPECT_THAT(tell(path, "two\nlines").error().what, HasSubstr("one line"));
  }
  EXPECT_THAT(tell(path, "list").error().what, HasSubstr("does not answer"));
  EXPECT_NE(::access(path.c_str(), F_OK), 0) << "it removes its socket";
}

TEST_F(Socket, SaysWhatIsInTheWay) {
  EXPECT_THAT(FaultSocket::open(in(std::string(120, 'x'))).error().what, HasSubstr("at most 107 bytes"));
  EXPECT_THAT(FaultSocket::open(write("file", "x")).error().what, HasSubstr("is no socket"));
  EXPECT_THAT(FaultSocket::open(in("no/such/folder")).error().what, HasSubstr("cannot make the socket"));
}

}  // namespace
}  // namespace ledgerline::hil::proxy
