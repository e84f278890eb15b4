#include "tools/station/core/requests.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "ground/service/core/api.hpp"
#include "ground/service/missions/approvals.hpp"

namespace ledgerline::station {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// What the station itself makes of a request.
ground::service::ApiAnswer answered(const Request& request) {
  static const std::vector<std::string> names{"tello1", "tello2"};
  static const std::deque<ground::service::Event> events;
  static const std::vector<ground::service::Operator> operators{{"alice", {"Org2MSP", "CN=alice"}}};
  const std::string target = "/api/v1/" + request.target;
  return ground::service::answer({request.method, target, request.body, 0, request.content_type},
                                 {names, "[]", "{}", events, operators});
}

TEST(ARequest, IsOneThatTheStationTakes) {
  for (const char* verb :
       {"takeoff", "land", "stop", "cut", "pause", "resume", "return", "acquire", "release", "request", "clear_stop"})
    EXPECT_EQ(answered(drone_request("tello1", verb)).status, 202U) << verb;
  const std::string to = to_body("Org2MSP", "CN=bob \"b\"");
  for (const char* verb : {"hand_over", "deny"}) {
    const auto answer = answered(drone_request("tello1", verb, to));
    ASSERT_EQ(answer.status, 202U) << answer.body;
    EXPECT_EQ(answer.call->to.subject, "CN=bob \"b\"");
  }
  EXPECT_EQ(answered(stop_all()).commands.size(), 2U);
  EXPECT_FALSE(answered(stop_all()).commands.at(0).cut);
  EXPECT_TRUE(answered(cut_all(false)).commands.at(0).cut);
  EXPECT_TRUE(answered(cut_all(true)).confirmed);
  EXPECT_EQ(answered(events_since(17)).status, 200U);
  EXPECT_EQ(answered(sign_in("alice", "open \"sesame\"")).sign_in->pass_phrase->view(), "open \"sesame\"");
}

constexpr const char* one_waypoint = "drone,x,y,z,speed\ntello1,1,2,,\n";

TEST(ARequest, IsOneOfMissions) {
  using Kind = ground::service::MissionRequest::Kind;
  const std::string id = "3f5a9c01d2e4";
  for (const auto& [verb, kind] : std::initializer_list<std::pair<const char*, Kind>>{{"approve", Kind::approve},
                                                                                      {"withdraw", Kind::withdraw},
                                                                                      {"start", Kind::start},
                                                                                      {"pause", Kind::pause},
                                                                                      {"resume", Kind::resume},
                                                                                      {"land", Kind::land}}) {
    const auto answer = answered(mission_request(id, verb));
    ASSERT_TRUE(answer.mission) << verb << ": " << answer.body;
    EXPECT_TRUE(answer.mission->kind == kind && answer.mission->id == id) << verb;
  }
  const auto added = answered(*mission_to_add("two.csv", one_waypoint, ""));
  ASSERT_TRUE(added.mission);
  EXPECT_TRUE(added.mission->csv && added.mission->name == "two" && added.mission->text == one_waypoint);
  EXPECT_FALSE(answered(*mission_to_add("two.json", "{}", "")).mission->csv);
}

TEST(ARequest, IsAnybodysWhereItOnlyLooksOrLands) {
  EXPECT_TRUE(drone_request("tello1", "land").anybodys && drone_request("tello1", "stop").anybodys);
  EXPECT_TRUE(stop_all().anybodys && events_since(0).anybodys);
  EXPECT_FALSE(drone_request("tello1", "cut").anybodys || cut_all(true).anybodys) << "motors off needs a session";
  EXPECT_FALSE(drone_request("tello1", "takeoff").anybodys || drone_request("tello1", "acquire").anybodys);
  EXPECT_TRUE(mission_request("3f", "land").anybodys);
  EXPECT_FALSE(mission_request("3f", "start").anybodys || mission_request("3f", "approve").anybodys);
}

TEST(APath, IsReadFromCsvInTheMap) {
  const auto body = path_body("x,y,z,speed\n1,2\n# there\n3,2,1.5,0.4\n", "way.csv", true);
  ASSERT_TRUE(body) << body.error().message;
  EXPECT_EQ(json::parse(*body), json::parse(R"({"waypoints":[{"x":1.0,"y":2.0},{"x":3.0,"y":2.0,"z":1.5,"speed":0.4}],
    "then":"land"})"));
  EXPECT_EQ(answered(drone_request("tello1", "path", *body)).status, 202U);
  EXPECT_EQ(answered(drone_request("tello1", "path", *path_body("1,1\n", "way.csv", false))).status, 202U);
}

TEST(APath, ThatIsWrongIsRefusedByFileAndLine) {
  EXPECT_THAT(path_body("1,2\nnorth,2\n", "way.csv", false).error().message, HasSubstr("way.csv:2: "));
  EXPECT_THAT(path_body("# nothing\n", "way.csv", false).error().message, HasSubstr("no point"));
  std::string many;
  for (int i = 0; i < 501; ++i) many += std::to_string(i % 2) + ",2\n";
  EXPECT_THAT(path_body(many, "way.csv", false).error().message, HasSubstr("more than 500"));
}

TEST(AMissionToAdd, ThatIsWrongIsRefusedByFileAndLine) {
  EXPECT_THAT(mission_to_add("some/two.csv", std::string(one_waypoint) + "tello1,1,south,,\n", "").error().message,
              testing::StartsWith("some/two.csv:3: y \"south\" is no number"));
}

TEST(AMissionToAdd, IsJsonOrCsvByItsName) {
  const auto csv = mission_to_add("some/two.csv", one_waypoint, "");
  ASSERT_TRUE(csv);
  EXPECT_EQ(csv->target, "missions?name=two");
  EXPECT_EQ(csv->content_type, "text/csv");
  EXPECT_EQ(mission_to_add("two.csv", one_waypoint, "survey-2")->target, "missions?name=survey-2");
  EXPECT_EQ(mission_to_add("two.json", "{}", "")->content_type, "application/json");
  EXPECT_THAT(mission_to_add("two.json", "{}", "other").error().message, HasSubstr("--name is for CSV"));
  EXPECT_THAT(mission_to_add("two.txt", "", "").error().message, HasSubstr("two.txt is neither"));
  EXPECT_THAT(mission_to_add("a b&c.csv", "", "").error().message, HasSubstr("no mission's name"));
  EXPECT_THAT(mission_to_add("two.csv", std::string(4'194'305, '1'), "").error().message, HasSubstr("4194304 may be"));
}

TEST(AMissionsDigest, IsThatOfTheStationAndOfTheApprovalOnTheLedger) {
  const auto mission = mission_from("some/two.csv", one_waypoint, "");
  ASSERT_TRUE(mission);
  const crypto::Digest digest = ground::mission::digest(*mission);
  const auto alone = digests_of(*mission, "", 0, 86'400);
  ASSERT_TRUE(alone);
  EXPECT_TRUE(alone->name == "two" && alone->digest == crypto::hex(digest) && alone->words.empty());
  const std::string canonical = ground::mission::canonical(*mission);
  for (const std::string& kept : {R"({"by":["Org2MSP","CN=alice"],"run":{"version":1,"mission":)" + canonical + "}}",
                                  R"({"name":"two","phase":"done","mission":)" + canonical + "}"}) {
    const auto read = mission_from("missions/0a1b.record.json", kept, "");
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(ground::mission::digest(*read), digest);
  }
  EXPECT_FALSE(mission_from("0a1b.json", R"({"by":null,"run":{"mission":{}}})", ""));
  for (const std::int64_t lasts_s : {86'400, 3'601}) {  // the odd one, too: half of it is cut
    const ground::service::ApprovalTerms terms({"Org2MSP", "CN=station"}, lasts_s);
    const std::int64_t given_s = 1'700'000'000, until_s = (terms.period(given_s) + 2) * (lasts_s / 2);
    const auto approval = digests_of(*mission, "Org2MSP CN=station", until_s, lasts_s);
    ASSERT_TRUE(approval) << approval.error().message;
    EXPECT_EQ(approval->words, terms.approval_words("two", given_s));
    EXPECT_EQ(approval->approval, crypto::hex(terms.now(digest, given_s).front().approval));
    EXPECT_EQ(approval->withdrawal, crypto::hex(terms.now(digest, given_s).front().withdrawal));
    EXPECT_THAT(digests_of(*mission, "Org2MSP CN=station", until_s + 1, lasts_s).error().message, HasSubstr("--until"));
  }
  EXPECT_THAT(digests_of(*mission, "station", 86'400, 86'400).error().message, HasSubstr("--ground"));
  EXPECT_THAT(mission_from("two.json", "{}", "").error().message, testing::StartsWith("two.json: "));
}

TEST(AnAnswer, IsARefusalInTheStationsWords) {
  EXPECT_TRUE(check_answer({202, R"({"accepted":true})"}));
  EXPECT_EQ(check_answer({409, R"({"error":"it is flown"})"}).error().message, "the station answers 409: it is flown");
  EXPECT_THAT(check_answer({500, "<html>"}).error().message, HasSubstr("500"));
  EXPECT_THAT(check_answer({301, ""}).error().message, HasSubstr("301"));
}

TEST(ASession, IsTakenFromTheAnswerAlone) {
  const std::string token(64, 'a');
  const auto session =
      session_from(json{{"session", token}, {"operator", "alice"}, {"identity", "Org2MSP CN=alice"}}.dump());
  ASSERT_TRUE(session);
  EXPECT_EQ(session->token, token);
  EXPECT_FALSE(session_from(R"({"session":"../../x","operator":"a","identity":"b"})"));
  EXPECT_FALSE(session_from("[]"));
  EXPECT_EQ(*signed_in_as(R"({"operators":[],"you":"alice"})"), "alice");
  EXPECT_EQ(*signed_in_as(R"({"operators":[],"you":null})"), "");
  EXPECT_FALSE(signed_in_as("{}"));
  EXPECT_EQ(*identity_signed_in(R"({"operators":[{"name":"alice","identity":"A CN=a"}],"you":"alice"})"), "A CN=a");
  EXPECT_EQ(*identity_signed_in(R"({"operators":[],"you":null})"), "");
  EXPECT_FALSE(identity_signed_in(R"({"operators":[],"you":"alice"})"));
}

TEST(StationAddress, WithoutTlsIsThisComputerAlone) {
  EXPECT_EQ(text_of(*address_from_url("http://127.0.0.1:8800")), "127.0.0.1:8800");
  EXPECT_EQ(text_of(*address_from_url("http://localhost:80/")), "127.0.0.1:80");
  EXPECT_EQ(text_of(*address_from_url("http://[::1]:80/")), "[::1]:80");
  for (const char* wrong : {"127.0.0.1:8800", "ftp://127.0.0.1:8800", "http://10.0.0.1:8800", "http://a.example:80",
                            "http://127.0.0.1", "http://127.0.0.1:0", "http://127.0.0.1:65536", "http://127.0.0.1:8x",
                            "http://127.0.0.1:80/api", "http://127.0.0.1@evil.example:80", ""})
    EXPECT_FALSE(address_from_url(wrong)) << wrong;
  EXPECT_THAT(address_from_url("http://10.0.0.1:8800").error().message, HasSubstr("https://"));
}

TEST(StationAddress, WithTlsIsAnyHost) {
  for (const char* host : {"ground.example.org:8800", "10.0.0.1:443", "[fd00::7]:8800", "localhost:8800"}) {
    const auto address = address_from_url(std::string("https://") + host);
    ASSERT_TRUE(address) << address.error().message;
    EXPECT_TRUE(address->tls);
    EXPECT_EQ(text_of(*address), host);
  }
  for (const char* wrong : {"https://ground.example.org", "https://ground.example.org:0", "https://:8800",
                            "https://a.example:80/api", "https://evil.example:80@a.example:80"})
    EXPECT_FALSE(address_from_url(wrong)) << wrong;
}

TEST(StationAddress, ThatIsThePagesAddressDoesNotShowItsTokenInTheError) {
  const std::string token(64, 'a');
  EXPECT_THAT(address_from_url("http://127.0.0.1:8800/#token=" + token).error().message,
              testing::Not(HasSubstr(token)));
}

TEST(StationAddress, OfAConfigIsItsFirstNameOrWhatItListensOn) {
  EXPECT_EQ(text_of(*address_from_service({.listen = "127.0.0.1:8800"})), "127.0.0.1:8800");
  EXPECT_THAT(address_from_service({.listen = "127.0.0.1:0"}).error().message, HasSubstr("port 0"));
  const auto secure = address_from_service({.listen = "0.0.0.0:8800", .tls = {"c", "k", ""}, .names = {"a.b", "c.d"}});
  EXPECT_EQ(text_of(*secure), "a.b:8800");
  EXPECT_TRUE(secure->tls);
}

}  // namespace
}  // namespace ledgerline::station
