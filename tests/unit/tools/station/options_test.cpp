#include "tools/station/shell/options.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "common/base/file.hpp"
#include "common/program/program.hpp"
#include "tests/fuzz/directory.hpp"

namespace ledgerline::station {
namespace {

using testing::HasSubstr;
using testing::Not;

class AStationsOptions : public testing::Test {
 protected:
  Result<Target> target() {
    return target_of(options, [this](const char* name) { return environment[name]; });
  }
  std::string config(const std::string& text) {
    const std::string file = directory.path + "/ground.toml";
    EXPECT_TRUE(write_file(file, text));
    return file;
  }

  fuzz::Directory directory;
  Options options;
  std::map<std::string, std::string> environment{{"HOME", "/home/pilot"}};
};

TEST_F(AStationsOptions, NameTheStationAndItsToken) {
  environment = {{"LEDGERLINE_STATION", "http://127.0.0.1:1"}, {"LEDGERLINE_TOKEN_FILE", "env.token"}, {"HOME", "/h"}};
  EXPECT_EQ(target()->address.at.port, 1);
  EXPECT_EQ(target()->token_file, "env.token");
  options.config = config("[flight]\nwings = 2\n[service]\nlisten = \"127.0.0.1:2\"\ntoken_file = \"config.token\"\n");
  EXPECT_EQ(target()->address.at.port, 2) << "what else is in the file is ground's to check";
  EXPECT_EQ(target()->token_file, "config.token");
  options.url = "http://127.0.0.1:3";
  options.token_file = "own.token";
  EXPECT_EQ(target()->address.at.port, 3);
  EXPECT_EQ(target()->token_file, "own.token");
}

TEST_F(AStationsOptions, SayWhoseCertificateTheStationHas) {
  const std::string secure =
      "[service]\nlisten = \"0.0.0.0:2\"\ntoken_file = \"t\"\nnames = [\"a.example\"]\n"
      "tls_certificate = \"own.pem\"\ntls_key = \"own.key\"\n";
  options.config = config(secure);
  ASSERT_TRUE(target()) << target().error().message;
  EXPECT_EQ(text_of(target()->address), "a.example:2");
  EXPECT_EQ(target()->tls.authority, "own.pem") << "who reads the config need not give it";
  EXPECT_EQ(target()->tls.certificate, "") << "that is the station's";
  environment["LEDGERLINE_CA"] = "env.pem";
  options.url = "https://b.example:2";
  EXPECT_EQ(target()->tls.authority, "env.pem") << "that is another station";
  options.tls.authority = "ca.pem";
  EXPECT_EQ(target()->tls.authority, "ca.pem");
  options.tls.certificate = "mine.pem";
  EXPECT_THAT(target().error().message, HasSubstr("go together"));
}

TEST_F(AStationsOptions, AreAskedForWhereTheyLack) {
  EXPECT_THAT(target().error().message, HasSubstr("LEDGERLINE_STATION"));
  options.url = "http://127.0.0.1:3";
  EXPECT_THAT(target().error().message, HasSubstr("LEDGERLINE_TOKEN_FILE"));
}

TEST_F(AStationsOptions, FindTheFlightOfThisUserWhereNothingNamesAStation) {
  environment["XDG_RUNTIME_DIR"] = directory.path;
  const std::string link = directory.path + "/ledgerline/flight.toml";
  ASSERT_TRUE(write_file(link, "[service]\nlisten = \"127.0.0.1:4\"\ntoken_file = \"flight.token\"\n"));
  EXPECT_EQ(target()->address.at.port, 4);
  EXPECT_EQ(target()->token_file, "flight.token");
  EXPECT_THAT(open(*target()).error().message, HasSubstr(link + " names it")) << "its run's folder was removed";
  options.token_file = "other.token";
  EXPECT_THAT(open(*target()).error().message, testing::AllOf(HasSubstr("other.token"), Not(HasSubstr(link))));
  options.token_file.clear();
  environment["LEDGERLINE_STATION"] = "http://127.0.0.1:5";
  environment["LEDGERLINE_TOKEN_FILE"] = "env.token";
  EXPECT_EQ(target()->address.at.port, 5);
  EXPECT_EQ(target()->hint, "");
}

TEST_F(AStationsOptions, CannotKnowAPortThatGroundChooses) {
  options.config = config("[service]\nlisten = \"127.0.0.1:0\"\ntoken_file = \"t\"\n");
  EXPECT_THAT(target().error().message, HasSubstr("port 0"));
  options.config = config("[flight]\n");
  EXPECT_THAT(target().error().message, HasSubstr("listen is not set"));
  options.config = config("[service]\nlisten = \"127.0.0.1:1\"\ntoken_file = \"t\"\nwings = 2\n");
  EXPECT_THAT(target().error().message, HasSubstr("wings"));
}

TEST_F(AStationsOptions, KeepASessionForEachStation) {
  options.url = "http://127.0.0.1:3";
  options.token_file = "t";
  EXPECT_EQ(target()->session_file, "/home/pilot/.cache/ledgerline/session-127.0.0.1-3");
  environment["XDG_RUNTIME_DIR"] = "/run/user/1";
  EXPECT_EQ(target()->session_file, "/run/user/1/ledgerline/session-127.0.0.1-3");
  environment.clear();
  EXPECT_EQ(target()->session_file, "");
  options.session_file = "s";
  EXPECT_EQ(target()->session_file, "s");
  EXPECT_TRUE(target()->session_expected) << "its lack is a warning";
  options.signs_in = true;
  EXPECT_FALSE(target()->session_expected) << "a sign-in makes it";
}

TEST_F(AStationsOptions, TakeNoTokenThatOthersMayRead) {
  Target target{.address = {{"127.0.0.1", 1}}, .token_file = directory.path + "/token", .session_file = {}};
  EXPECT_FALSE(open(target));
  ASSERT_TRUE(write_file(target.token_file, std::string(64, 'a') + "\n", 0644));
  EXPECT_THAT(open(target).error().message, HasSubstr("chmod 600"));
  ASSERT_TRUE(replace_file(target.token_file, "too short\n", 0600));
  EXPECT_THAT(open(target).error().message, HasSubstr("64 hex digits"));
  ASSERT_TRUE(replace_file(target.token_file, "", 0600));
  EXPECT_THAT(open(target).error().message, HasSubstr("token is empty: remove it"));
  ASSERT_TRUE(replace_file(target.token_file, std::string(64, 'a') + "\n", 0600));
  EXPECT_TRUE(open(target));
}

TEST_F(AStationsOptions, AreNotStoppedByASessionThatCannotBeRead) {
  Target target{.address = {{"127.0.0.1", 1}},
                .token_file = directory.path + "/token",
                .session_file = directory.path + "/session",
                .session_expected = true};
  ASSERT_TRUE(replace_file(target.token_file, std::string(64, 'a'), 0600));
  EXPECT_TRUE(open(target));
  ASSERT_TRUE(write_file(target.session_file, "readable by all\n", 0644));
  EXPECT_TRUE(open(target));
}

TEST_F(AStationsOptions, ReadTheFirstLineOfASecret) {
  const std::string file = directory.path + "/secret";
  ASSERT_TRUE(replace_file(file, "open sesame\r\nmore\n", 0600));
  EXPECT_EQ(*read_secret(file), "open sesame");
  ASSERT_TRUE(replace_file(file, std::string(5'000, 'a'), 0600));
  EXPECT_FALSE(read_secret(file));
  EXPECT_THAT(read_secret(directory.path).error().message, HasSubstr("no regular file"));
}

TEST(AStationThatIsGone, IsSaidSo) {
  for (const bool tls : {false, true}) {
    const auto station = Station::open({{"127.0.0.1", 1}, tls}, {std::string(64, 'a'), "", ""});
    ASSERT_TRUE(station);
    EXPECT_THAT((*station)->request({.target = "drones"}).error().message, HasSubstr("127.0.0.1:1 is not reached"));
  }
}

}  // namespace
}  // namespace ledgerline::station
