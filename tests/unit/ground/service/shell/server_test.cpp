#include "ground/service/shell/server.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <future>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "common/base/file.hpp"
#include "ground/service/core/connection_quota.hpp"
#include "ground/service/shell/page_files.hpp"
#include "tests/fuzz/directory.hpp"

namespace ledgerline::ground::service {
namespace {

namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using boost::asio::ip::tcp;
using nlohmann::json;
using testing::HasSubstr;

/// Alice's pass phrase is "open".
class TestKeys final : public OperatorKeys {
 public:
  const std::vector<Operator>& operators() const override { return operators_; }
  void unlock(std::size_t, std::shared_ptr<const crypto::WipingString> pass_phrase,
              std::function<void(Status)> answer) override {
    threads_.emplace_back([answer = std::move(answer), right = pass_phrase->view() == "open"] {
      answer(right ? Status(done) : Error{"a wrong pass phrase"});
    });
  }
  void on_session_over(std::size_t who) override { left.push_back(who); }
  Status submit(std::size_t who, const OperatorCall& call) override {
    calls.emplace_back(who, call.kind);
    return done;
  }
  std::vector<std::size_t> left;
  std::vector<std::pair<std::size_t, OperatorCall::Kind>> calls;

 private:
  const std::vector<Operator> operators_{{"alice", {"Org2MSP", "CN=alice"}}};
  std::vector<std::jthread> threads_;
};

class StationServer : public testing::Test {
 protected:
  explicit StationServer(OperatorKeys* keys = nullptr) {
    settings.listen = "127.0.0.1:0";
    settings.token_file = directory.path + "/" + "page.token";
    settings.session_idle_ns = 60 * ns_per_s;
    const auto take = [this](const PilotCommand& command) -> Status {
      if (command.takeoff && !reached) return Error{"the ledger is not reached yet"};
      const std::lock_guard lock(mutex);
      commands.push_back(command);
      return done;
    };
    // On a thread of its own, as the flight's is.
    const auto request_mission = [this](MissionRequest asked, std::function<void(ApiAnswer)> answer) {
      threads.emplace_back([asked = std::move(asked), answer = std::move(answer)] {
        answer({asked.kind == MissionRequest::Kind::add ? 201U : 202U, std::to_string(asked.text.size())});
      });
    };
    const auto request_fault = [this](const FaultRequest& asked, std::function<void(ApiAnswer)> answer) {
      if (asked.name == "slow") return late.set_value(std::move(answer));
      threads.emplace_back([asked, answer = std::move(answer)] { answer({200, command_of(asked)}); });
    };
    auto started =
        Server::start(settings, {"tello1"}, {.manual = true, .speed_mps = 0.5},
                      {.take = take, .keys = keys, .request_mission = request_mission, .request_fault = request_fault});
    if (!started) throw std::runtime_error(started.error().message);
    server = std::move(*started);
    place = server->url().substr(std::string("http://").size());
    token = read_file(settings.token_file)->substr(0, token_digits);
  }

  tcp::socket dial() {
    tcp::socket socket(io);
    socket.connect({boost::asio::ip::make_address_v4("127.0.0.1"),
                    static_cast<std::uint16_t>(std::stoi(place.substr(place.find(':') + 1)))});
    return socket;
  }
  http::response<http::string_body> ask(http::verb verb, const std::string& target, const std::string& bearer,
                                        const std::string& body = "", const std::string& encoding = "") {
    tcp::socket socket = dial();
    http::request<http::string_body> request{verb, target, 11};
    request.set(http::field::host, place);
    if (!bearer.empty()) request.set(http::field::authorization, "Bearer " + bearer);
    request.body() = body;
    if (!encoding.empty()) request.set(http::field::accept_encoding, encoding);
    request.prepare_payload();
    http::write(socket, request);
    beast::flat_buffer buffer;
    http::response<http::string_body> response;
    http::read(socket, buffer, response);
    return response;
  }
  using Stream = websocket::stream<tcp::socket>;
  std::unique_ptr<Stream> stream(const std::string& of = "") {
    auto opened = std::make_unique<Stream>(dial());
    opened->set_option(websocket::stream_base::decorator([&](websocket::request_type& request) {
      request.set(http::field::sec_websocket_protocol, "ledgerline.v1, token." + (of.empty() ? token : of));
    }));
    opened->handshake(place, "/api/v1/stream");
    return opened;
  }
  static json read(Stream& from) {
    beast::flat_buffer buffer;
    from.read(buffer);
    return json::parse(beast::buffers_to_string(buffer.data()));
  }
  void publish_event(std::uint64_t number) {
    server->publish({.drones = "[]",
                     .state = R"({"op":"state","drones":[]})",
                     .events = {{number, 1, Level::info, "tello1", "event"}}});
  }
  std::size_t heard() {
    const std::lock_guard lock(mutex);
    return commands.size();
  }

  fuzz::Directory directory;
  boost::asio::io_context io;
  std::mutex mutex;
  std::vector<PilotCommand> commands;
  std::atomic<bool> reached{true};
  std::vector<std::jthread> threads;
  std::promise<std::function<void(ApiAnswer)>> late;  ///< of who asks for "slow"
  ServiceSettings settings;
  std::unique_ptr<Server> server;
  std::string place, token;
};

TEST_F(StationServer, ServesItsPageToAnybodyHereAndTheApiToWhoKnowsTheToken) {
  const auto page = ask(http::verb::get, "/", "");
  EXPECT_EQ(page.result_int(), 200U);
  EXPECT_THAT(page.body(), HasSubstr("<html"));
  EXPECT_THAT(std::string(page["Content-Security-Policy"]), HasSubstr("default-src 'none'"));
  EXPECT_EQ(ask(http::verb::get, "/page/main.js", "").result_int(), 200U);
  EXPECT_EQ(ask(http::verb::get, "/page/../page.token", "").result_int(), 404U);
  EXPECT_EQ(ask(http::verb::get, "/api/v1/drones", "").result_int(), 401U);
  EXPECT_EQ(ask(http::verb::get, "/api/v1/drones", token).result_int(), 200U);
  EXPECT_EQ(ask(http::verb::post, "/api/v1/drones/tello1/takeoff", "").result_int(), 401U);
  EXPECT_EQ(heard(), 0U);
  EXPECT_EQ(ask(http::verb::post, "/api/v1/drones/tello1/takeoff", token).result_int(), 202U);
  EXPECT_EQ(heard(), 1U);
}

TEST_F(StationServer, ServesTheLibrariesCompressedToWhoTakesThatAndNamesThePagesOwnScript) {
  const auto library = ask(http::verb::get, "/page/lib/built.js", "", "", "deflate, gzip");
  EXPECT_EQ(library.result_int(), 200U);
  EXPECT_EQ(library[http::field::content_encoding], "gzip");
  EXPECT_EQ(library[http::field::content_type], "text/javascript; charset=utf-8");
  EXPECT_EQ(ask(http::verb::get, "/page/lib/built.js", "").result_int(), 406U);
  const auto page = ask(http::verb::get, "/", "");
  EXPECT_EQ(page[http::field::content_encoding], "");
  EXPECT_THAT(std::string(page["Content-Security-Policy"]),
              HasSubstr("script-src 'self' " + std::string(page_scripts) + ";"));
}

TEST_F(StationServer, AClientHearsEveryEventInOrderAndTheNewestState) {
  const auto client = stream();
  EXPECT_EQ(read(*client)["op"], "hello");
  for (std::uint64_t number = 1; number <= 200; ++number) publish_event(number);
  std::uint64_t newest = 0;
  while (newest < 200) {
    for (const json& event : read(*client).value("events", json::array())) EXPECT_EQ(event["n"], ++newest);
  }
  while (read(*client)["op"] != "state") continue;
}

TEST_F(StationServer, AClientGetsTheNewestBlocksAndNoneThatItHas) {
  std::vector<BlockSummary> blocks;
  for (std::uint64_t number = 1; number <= 120; ++number) blocks.push_back({.number = number});
  server->publish_blocks(blocks);
  const auto client = stream();
  publish_event(1);
  const auto next = [&] {
    json said = read(*client);
    while (said["op"] != "blocks") said = read(*client);
    return said["blocks"];
  };
  const json first = next();
  ASSERT_EQ(first.size(), max_reported_blocks);
  EXPECT_EQ(first[0]["n"], 71) << "those before are nobody's news any more";
  server->publish_blocks({{.number = 121}});
  const json second = next();
  ASSERT_EQ(second.size(), 1U);
  EXPECT_EQ(second[0]["n"], 121);
}

TEST_F(StationServer, EventsStatesAndBlocksDoNotKeepEachOtherBack) {
  const auto client = stream();
  for (std::uint64_t round = 1; round <= 100; ++round) {
    server->publish_blocks({{.number = round}});
    publish_event(round);
    std::set<std::string> missing{"events", "state", "blocks"};
    while (!missing.empty()) missing.erase(read(*client)["op"]);
  }
}

TEST_F(StationServer, AStateDoesNotWaitUntilAPilotsComputerHasAcknowledgedItsBeginning) {
  const auto pilot = stream();
  const std::string state = json{{"op", "state"}, {"drones", std::string(10'000, 'x')}}.dump();
  std::vector<TimeNs> took_ns;
  while (took_ns.size() < 40) {
    pilot->write(boost::asio::buffer(
        std::string(R"({"op":"velocity","drone":"tello1","linear":[0.1,0,0],"yaw_rate":0,"t_ms":0})")));
    std::this_thread::sleep_for(std::chrono::milliseconds(33));
    const TimeNs begin_ns = monotonic_ns();
    server->publish({.drones = "[]", .state = state});
    while (read(*pilot)["op"] != "state") continue;
    took_ns.push_back(monotonic_ns() - begin_ns);
  }
  std::sort(took_ns.begin(), took_ns.end());
  EXPECT_LT(took_ns[30], 20 * ns_per_ms) << "who talks himself acknowledges with what he says next, or after 40 ms";
}

TEST_F(StationServer, AClientThatDoesNotReadIsClosedAndTheOthersGoOn) {
  const auto deaf = stream(), client = stream();
  const std::string words(2000, 'x');
  std::uint64_t newest = 0;
  for (std::uint64_t number = 1; number <= 6'000; ++number) {
    server->publish({.drones = "[]", .state = "{}", .events = {{number, 1, Level::info, "", words}}});
    while (number % 100 == 0 && newest < number) {
      for (const json& event : read(*client).value("events", json::array())) newest = event["n"];
    }
  }
  EXPECT_EQ(newest, 6'000U);
  beast::flat_buffer buffer;
  beast::error_code error;
  while (!error) {
    deaf->read(buffer, error);
    buffer.clear();
  }
  EXPECT_TRUE(server->watched());
}

TEST_F(StationServer, WhatIsNoVelocityEndsTheStreamWithTheReason) {
  const auto client = stream();
  client->write(boost::asio::buffer(
      std::string(R"({"op":"velocity","drone":"tello1","linear":[0.1,0,0],"yaw_rate":0,"t_ms":0})")));
  client->write(boost::asio::buffer(std::string(R"({"op":"fly"})")));
  beast::flat_buffer buffer;
  beast::error_code error;
  while (!error) client->read(buffer, error);
  EXPECT_EQ(error, websocket::error::closed);
  EXPECT_EQ(client->reason().code, websocket::close_code::policy_error);
  EXPECT_EQ(heard(), 1U);
}

TEST_F(StationServer, AnOpenStreamStopsAndLandsWithoutAnotherConnection) {
  const auto client = stream();
  const auto answer_to = [&](const std::string& message) {
    client->write(boost::asio::buffer(message));
    json said = read(*client);
    while (said["op"] != "answer") said = read(*client);
    return said;
  };
  EXPECT_EQ(answer_to(R"({"op":"stop","id":7})"), json::parse(R"({"op":"answer","id":7,"status":202})"));
  EXPECT_EQ(answer_to(R"({"op":"land","drone":"tello1","id":8})")["status"], 202);
  ASSERT_EQ(heard(), 2U);
  EXPECT_TRUE(commands[0].stop && commands[1].land);
  reached = false;
  for (int i = 0; i < 300; ++i) client->write(boost::asio::buffer(std::string(R"({"op":"stop"})")));
  EXPECT_EQ(answer_to(R"({"op":"stop","id":9})")["status"], 202) << "a budget is no reason to keep a drone in the air";
}

TEST_F(StationServer, SeventyStreamsWithThePagesTokenLeaveWayForAStop) {
  std::vector<std::unique_ptr<Stream>> streams;
  std::size_t refused = 0;
  for (int i = 0; i < 70; ++i) {
    try {
      streams.push_back(stream());
    } catch (const std::exception&) {
      ++refused;
    }
  }
  EXPECT_EQ(streams.size(), ConnectionQuota::max_of_one);
  EXPECT_EQ(refused, 70 - ConnectionQuota::max_of_one);
  const auto stopped = ask(http::verb::post, "/api/v1/stop", token);
  EXPECT_EQ(stopped.result_int(), 202U);
  EXPECT_FALSE(stopped.keep_alive()) << "it has no place";
  streams.front()->write(boost::asio::buffer(std::string(R"({"op":"stop","id":1})")));
  json said = read(*streams.front());
  while (said["op"] != "answer") said = read(*streams.front());
  EXPECT_EQ(said["status"], 202);
  EXPECT_EQ(heard(), 2U);
}

TEST_F(StationServer, TheLastEventsReachEveryoneBeforeItEnds) {
  const auto client = stream();
  EXPECT_EQ(read(*client)["op"], "hello");
  publish_event(1);
  std::jthread ending([&] { server->end(); });
  bool reported = false;
  beast::flat_buffer buffer;
  beast::error_code error;
  while (!error) {
    client->read(buffer, error);
    reported = reported || beast::buffers_to_string(buffer.data()).find("\"events\"") != std::string::npos;
    buffer.clear();
  }
  EXPECT_TRUE(reported);
  EXPECT_EQ(client->reason().code, websocket::close_code::going_away);
}

/// Made before the server that uses it, and gone behind it.
struct HasKeys {
  TestKeys keys;
};
class StationWithOperators : public HasKeys, public StationServer {
 protected:
  StationWithOperators() : StationServer(&keys) {}
  std::string sign_in() {
    const auto in = ask(http::verb::post, "/api/v1/session", token, R"({"operator":"alice","passphrase":"open"})");
    EXPECT_EQ(in.result_int(), 200U) << in.body();
    return json::parse(in.body()).value("session", "");
  }
};

TEST_F(StationWithOperators, TheRightPassPhraseOpensASessionAndTheWrongOneSoonHasToWait) {
  const std::string takeoff = "/api/v1/drones/tello1/takeoff";
  EXPECT_EQ(ask(http::verb::post, takeoff, token).result_int(), 403U) << "the page's token flies nothing here";
  const std::string session = sign_in();
  EXPECT_EQ(session.size(), token_digits);
  EXPECT_EQ(ask(http::verb::post, takeoff, session).result_int(), 202U);
  ASSERT_EQ(heard(), 1U);
  EXPECT_EQ(commands[0].by->subject, "CN=alice");
  EXPECT_EQ(ask(http::verb::post, "/api/v1/drones/tello1/acquire", session).result_int(), 202U);
  EXPECT_EQ(keys.calls.size(), 1U);
  const std::string wrong = R"({"operator":"alice","passphrase":"opne"})";
  for (int i = 0; i < Attempts::free_of_address; ++i)
    EXPECT_EQ(ask(http::verb::post, "/api/v1/session", token, wrong).result_int(), 403U);
  EXPECT_EQ(ask(http::verb::post, takeoff, session).result_int(), 202U) << "who is in stays in";
  const TimeNs before = monotonic_ns();
  EXPECT_EQ(sign_in().size(), token_digits) << "nobody is locked out";
  EXPECT_GE(monotonic_ns() - before, Attempts::pause_ns) << "and guessing is slow";
}

TEST_F(StationWithOperators, WhoIsNoOperatorAnyMoreIsSignedOutAndStaysOut) {
  const std::string session = sign_in();
  server->dismiss({0});
  EXPECT_EQ(ask(http::verb::post, "/api/v1/drones/tello1/takeoff", session).result_int(), 401U);
  EXPECT_EQ(keys.left.size(), 1U);
  const std::string right = R"({"operator":"alice","passphrase":"open"})";
  EXPECT_EQ(ask(http::verb::post, "/api/v1/session", token, right).result_int(), 403U);
  EXPECT_EQ(ask(http::verb::post, "/api/v1/stop", session).result_int(), 202U) << "it still stops";
  server->dismiss({});
  EXPECT_EQ(sign_in().size(), token_digits);
}

TEST_F(StationWithOperators, ASessionThatIsOverFliesNothing) {
  const std::string session = sign_in();
  const auto flown = stream(session), looked = stream();
  EXPECT_EQ(read(*flown)["op"], "hello");
  EXPECT_EQ(read(*looked)["op"], "hello");
  EXPECT_EQ(ask(http::verb::delete_, "/api/v1/session", session).result_int(), 202U);
  EXPECT_EQ(keys.left.size(), 1U);
  EXPECT_EQ(ask(http::verb::post, "/api/v1/drones/tello1/takeoff", session).result_int(), 401U) << "replayed";
  EXPECT_EQ(ask(http::verb::get, "/api/v1/drones", session).result_int(), 401U);
  EXPECT_THROW(stream(session), std::exception);
  const std::string velocity = R"({"op":"velocity","drone":"tello1","linear":[0.1,0,0],"yaw_rate":0,"t_ms":0})";
  for (Stream* client : {flown.get(), looked.get()}) {
    client->write(boost::asio::buffer(velocity));
    beast::flat_buffer buffer;
    beast::error_code error;
    while (!error) client->read(buffer, error);
    EXPECT_EQ(error, websocket::error::closed);
  }
  EXPECT_EQ(heard(), 0U);
  EXPECT_EQ(ask(http::verb::post, "/api/v1/stop", token).result_int(), 202U) << "a stop needs no operator";
}

TEST_F(StationWithOperators, ASessionThatIsOverStillStopsAndLands) {
  const std::string first = sign_in(), second = sign_in();
  EXPECT_EQ(ask(http::verb::delete_, "/api/v1/session", second).result_int(), 202U);
  const std::string guessed(token_digits, 'a');
  for (const char* target : {"/api/v1/stop", "/api/v1/drones/tello1/stop", "/api/v1/drones/tello1/land"}) {
    for (const std::string& of : {first, second}) {
      const auto taken = ask(http::verb::post, target, of);
      EXPECT_EQ(taken.result_int(), 202U) << target;
      EXPECT_FALSE(taken.keep_alive()) << "it is an unauthenticated client's connection";
    }
    EXPECT_EQ(ask(http::verb::post, target, guessed).result_int(), 401U) << target;
  }
  ASSERT_EQ(heard(), 6U);
  EXPECT_FALSE(commands[0].by) << "ground signs it: the operator's key is locked";
}

TEST_F(StationWithOperators, OnlookersLeaveAnOperatorHisPlacesAndCutNothing) {
  const std::string session = sign_in();
  std::vector<std::unique_ptr<Stream>> onlookers;
  for (std::size_t i = 0; i < ConnectionQuota::max_of_one; ++i) onlookers.push_back(stream());
  EXPECT_THROW(stream(), std::exception);
  const auto own = stream(session);
  const auto answer_to = [](Stream& client, const std::string& message) {
    client.write(boost::asio::buffer(message));
    json said = read(client);
    while (said["op"] != "answer") said = read(client);
    return said;
  };
  EXPECT_EQ(answer_to(*onlookers[0], R"({"op":"cut","drone":"tello1","confirmed":true,"id":1})")["status"], 403);
  EXPECT_EQ(heard(), 0U);
  EXPECT_EQ(answer_to(*own, R"({"op":"cut","drone":"tello1","confirmed":true,"id":2})")["status"], 202);
  EXPECT_EQ(answer_to(*onlookers[1], R"({"op":"stop","id":3})")["status"], 202);
  ASSERT_EQ(heard(), 2U);
  EXPECT_TRUE(commands[0].cut && commands[0].by);
  EXPECT_TRUE(commands[1].stop && !commands[1].cut && !commands[1].by);
}

TEST_F(StationServer, ACommandThatIsNotAcceptedNowIsAnswered503) {
  reached = false;
  const auto refused = ask(http::verb::post, "/api/v1/drones/tello1/takeoff", token);
  EXPECT_EQ(refused.result_int(), 503U);
  EXPECT_THAT(refused.body(), HasSubstr("the ledger is not reached yet"));
  EXPECT_EQ(ask(http::verb::post, "/api/v1/stop", token).result_int(), 202U);
  EXPECT_EQ(heard(), 1U);
}

TEST_F(StationServer, AMissionMayBeLongFromWhoKnowsTheTokenAlone) {
  const std::string text(1'000'000, 'x');
  const auto added = ask(http::verb::post, "/api/v1/missions", token, text);
  EXPECT_EQ(added.result_int(), 201U);
  EXPECT_EQ(added.body(), "1000000");
  EXPECT_EQ(ask(http::verb::post, "/api/v1/missions/abc/start", token).result_int(), 202U);
  for (const auto& [target, bearer] :
       {std::pair("/api/v1/missions", std::string("0")), std::pair("/api/v1/drones/tello1/path", token)}) {
    beast::error_code error;
    tcp::socket socket = dial();
    http::request<http::string_body> request{http::verb::post, target, 11, text};
    request.set(http::field::host, place);
    request.set(http::field::authorization, "Bearer " + bearer);
    request.prepare_payload();
    http::write(socket, request, error);  // it need not take all of it
    beast::flat_buffer buffer;
    http::response<http::string_body> response;
    http::read(socket, buffer, response, error);
    EXPECT_TRUE(error || response.result_int() == 413U) << target;
  }
}

TEST_F(StationServer, MissionsAreReportedWhenTheyChange) {
  const auto client = stream();
  EXPECT_EQ(read(*client)["op"], "hello");
  server->publish_missions(R"([{"id":"1"}])");
  const json reported = read(*client);
  EXPECT_EQ(reported["op"], "missions");
  EXPECT_EQ(reported["missions"][0]["id"], "1");
}

TEST_F(StationServer, FaultsAreReportedWhenTheyChangeAndSwitchedBesideTheFlight) {
  EXPECT_EQ(ask(http::verb::get, "/api/v1/faults", token).result_int(), 503U) << "nothing is known yet";
  const auto client = stream();
  server->publish_faults({.switches = {{.name = "silent", .drone = "tello1", .label = "Silent", .words = "w"}}});
  json reported = json::object();
  while (reported.value("op", "") != "faults") reported = read(*client);
  EXPECT_EQ(reported["faults"][0]["name"], "silent");
  const std::string on = R"({"name":"silent","on":true})";
  EXPECT_EQ(ask(http::verb::post, "/api/v1/faults", "", on).result_int(), 401U);
  EXPECT_EQ(ask(http::verb::post, "/api/v1/faults", token, on).body(), "on silent");
}

TEST_F(StationServer, AnAnswerBehindTheServersEndIsDropped) {
  auto client = stream();
  server->publish_faults({.switches = {{.name = "slow", .drone = "tello1", .label = "Slow", .words = "w"}}});
  while (read(*client).value("op", "") != "faults") continue;
  tcp::socket asking = dial();
  http::request<http::string_body> request{http::verb::post, "/api/v1/faults", 11};
  request.set(http::field::host, place);
  request.set(http::field::authorization, "Bearer " + token);
  request.body() = R"({"name":"slow","on":true})";
  request.prepare_payload();
  http::write(asking, request);
  const std::function<void(ApiAnswer)> answer = late.get_future().get();
  server.reset();
  answer({200, "too late"});
  beast::flat_buffer buffer;
  http::response<http::string_body> response;
  EXPECT_THROW(http::read(asking, buffer, response), boost::system::system_error)
      << "its connection ends with the server";
}

TEST_F(StationServer, APathIsReportedWhenItChangesAndToWhoComesLater) {
  const auto early = stream();
  EXPECT_EQ(read(*early)["op"], "hello");
  server->publish({.drones = "[]", .state = R"({"op":"state"})", .paths = R"({"tello1":[[1,2,3]]})"});
  EXPECT_EQ(read(*early)["paths"]["tello1"][0][2], 3);
  EXPECT_EQ(read(*early)["op"], "state");
  server->publish({.drones = "[]", .state = R"({"op":"state","t_ms":2})"});
  EXPECT_EQ(read(*early)["t_ms"], 2);
  const auto late = stream();
  EXPECT_EQ(read(*late)["op"], "hello");
  EXPECT_EQ(read(*late)["op"], "paths");
}

TEST_F(StationServer, OutsidersKeepNobodyOut) {
  std::vector<tcp::socket> silent;
  for (std::size_t i = 0; i < max_unauthenticated + 50; ++i) silent.push_back(dial());
  EXPECT_EQ(ask(http::verb::post, "/api/v1/stop", token).result_int(), 202U);
  EXPECT_EQ(heard(), 1U);
  // Nor does one who asks again and again on one connection.
  tcp::socket asking = dial();
  http::request<http::empty_body> request{http::verb::get, "/", 11};
  request.set(http::field::host, place);
  http::write(asking, request);
  beast::flat_buffer buffer;
  http::response<http::string_body> page;
  http::read(asking, buffer, page);
  EXPECT_EQ(page.result_int(), 200U);
  EXPECT_FALSE(page.keep_alive());
}

TEST_F(StationServer, AClientMayJoinBehindMoreEventsThanAreKept) {
  for (std::uint64_t number = 1; number <= 3 * Server::max_events; ++number) publish_event(number);
  const auto client = stream();
  EXPECT_EQ(read(*client)["op"], "hello");
  const json first = read(*client);
  ASSERT_EQ(first["op"], "events");
  EXPECT_EQ(first["events"].size(), Server::max_events);
}

TEST_F(StationServer, OnlyAStreamIsWorthPublishingOftenFor) {
  tcp::socket kept = dial();
  EXPECT_EQ(ask(http::verb::get, "/api/v1/drones", token).result_int(), 200U);
  EXPECT_FALSE(server->watched());
  const auto client = stream();
  EXPECT_EQ(read(*client)["op"], "hello");
  EXPECT_TRUE(server->watched());
}

TEST(StationToken, IsMadeOnceForItsOwnerAloneAndAnOpenOneIsRefused) {
  const fuzz::Directory directory;
  const std::string file = directory.path + "/" + "token";
  const auto made = read_token(file), again = read_token(file);
  ASSERT_TRUE(made && again);
  EXPECT_EQ(*made, *again);
  EXPECT_EQ(made->size(), token_digits);
  ASSERT_EQ(::chmod(file.c_str(), 0640), 0);
  const auto open = read_token(file);
  ASSERT_FALSE(open);
  EXPECT_THAT(open.error().message, HasSubstr("chmod 600"));
  ASSERT_TRUE(replace_file(file, "short", 0600));
  EXPECT_FALSE(read_token(file));
  ASSERT_TRUE(replace_file(file, "", 0600));
  EXPECT_THAT(read_token(file).error().message, HasSubstr("is empty: remove it, and a new one is made"));
  EXPECT_FALSE(read_token(""));
}

TEST(StationPlace, IsThisComputerAlone) {
  const fuzz::Directory directory;
  for (const char* listen :
       {"0.0.0.0:8800", "10.0.0.1:8800", "127.0.0.1", "127.0.0.1:65536", "127.0.0.1:x", "localhost:8800"}) {
    ServiceSettings settings;
    settings.listen = listen;
    settings.token_file = directory.path + "/" + "token";
    const auto server = Server::start(settings, {}, {}, {.take = [](const PilotCommand&) { return Status(done); }});
    ASSERT_FALSE(server) << listen;
    EXPECT_THAT(server.error().message, HasSubstr("[service] listen"));
  }
}

}  // namespace
}  // namespace ledgerline::ground::service
