#include "ground/service/core/guard.hpp"
#include "ground/service/core/stream_messages.hpp"
#include "tests/fuzz/entry.hpp"

/// What the station's clients say: a request's line and body, the stream's messages, and heads that the guard checks.
namespace ledgerline::fuzz::station_part {
namespace {

using namespace ground::service;

const std::vector<std::string> names{"tello1", "tello2"};

/// METHOD TARGET, a line's end, the body.
class RequestEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    return {
        "GET /api/v1/drones\n",
        "GET /api/v1/paths\n",
        "GET /api/v1/events?since=12\n",
        "POST /api/v1/drones/tello1/takeoff\n{}",
        "POST /api/v1/drones/tello1/path\n{\"waypoints\":[{\"x\":1,\"y\":2,\"z\":1,\"speed\":0.5}],\"then\":\"land\"}",
        "POST /api/v1/stop\n{\"cut\":true,\"confirmed\":true}",
        "POST /api/v1/drones/tello1/cut\n{\"confirmed\":true}",
        "POST /api/v1/drones/tello2/land\n",
        "POST /api/v1/session\n{\"operator\":\"alice\",\"passphrase\":\"open\"}",
        "POST /api/v1/drones/tello1/hand_over\n{\"to\":{\"msp\":\"Org2MSP\",\"subject\":\"CN=bob\"}}",
        "POST /api/v1/faults\n{\"name\":\"silent-tello1\",\"on\":true}",
        "POST /api/v1/drones/tello1/acquire\n{\"priority\":3}"};
  }
  Outcome feed(std::string_view bytes) override {
    const auto end = std::min(bytes.find('\n'), bytes.size());
    const std::string_view line = bytes.substr(0, end), body = bytes.substr(std::min(end + 1, bytes.size()));
    const auto blank = std::min(line.find(' '), line.size());
    ApiRequest request{line.substr(0, blank), line.substr(std::min(blank + 1, line.size())), body};
    const ApiContext known{names, "[]", "{}", events_, operators_, &faults_};
    const ApiAnswer outsiders = answer(request, known);
    // Nobody is signed in: nothing is signed, nothing flies, and no motors are cut.
    const bool flies = !std::all_of(outsiders.commands.begin(), outsiders.commands.end(), ground::only_lands);
    const bool spoils = outsiders.fault && outsiders.fault->on;
    if (outsiders.call || outsiders.sign_out || flies || spoils) return refused("");
    request.who = 0;
    const ApiAnswer made = answer(request, known);
    if (made.status < 300) return accepted();
    // A refused request must not move a drone.
    return made.commands.empty() ? refused(made.body) : refused("");
  }

 private:
  const std::vector<Operator> operators_{{"alice", {"Org2MSP", "CN=alice"}}};
  const std::deque<Event> events_{{1, 1, Level::info, "tello1", "takeoff"}};
  const FaultList faults_{.switches = {{.name = "silent-tello1", .drone = "tello1", .label = "Silent", .words = "w"}}};
};

class StreamEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    return {R"({"op":"velocity","drone":"tello1","linear":[0.5,0,-0.25],"yaw_rate":0.3,"t_ms":900})",
            R"({"op":"velocity","drone":"tello2","linear":[0,0,0],"yaw_rate":0,"t_ms":100})", R"({"op":"stop","id":7})",
            R"({"op":"cut","drone":"tello1","confirmed":true})", R"({"op":"land","drone":"tello2","id":1})"};
  }
  Outcome feed(std::string_view bytes) override {
    const auto onlookers = read_stream_message(bytes, {}, known_, ns_per_s);
    if (!onlookers) return refused(onlookers.error().message);
    if (!onlookers->command) return accepted();
    // An onlooker lands, and does nothing else.
    const auto& commands = onlookers->command->made.commands;
    if (!std::all_of(commands.begin(), commands.end(), ground::only_lands)) return refused("");
    const auto operators = read_stream_message(bytes, {.who = 0}, known_, ns_per_s);
    const ApiAnswer& made = operators->command->made;
    return made.status < 300 ? accepted() : refused(made.body);
  }

 private:
  const std::deque<Event> events_{};
  const std::vector<Operator> operators_{{"alice", {"Org2MSP", "CN=alice"}}};
  const ApiContext known_{names, "[]", "{}", events_, operators_};
};

/// Host, Origin and token, a line each: only the right ones are heard.
class HeadEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    return {"127.0.0.1:8800\n\nBearer " + token_, "localhost:8800\nhttp://localhost:8800\nBearer " + token_};
  }
  Outcome feed(std::string_view bytes) override {
    const auto first = std::min(bytes.find('\n'), bytes.size());
    const std::string_view rest = bytes.substr(std::min(first + 1, bytes.size()));
    const auto second = std::min(rest.find('\n'), rest.size());
    Head head{.host = bytes.substr(0, first),
              .origin = rest.substr(0, second),
              .authorization = rest.substr(std::min(second + 1, rest.size()))};
    const ApiAnswer plain = guard_.check(head, nobody_).refused;
    head.websocket = true;
    head.subprotocols = std::exchange(head.authorization, "");
    if (guard_.check(head, nobody_).refused.status == 0) return refused("");  // a header's words are no subprotocol
    return plain.status == 0 ? accepted() : refused(plain.body);
  }

 private:
  const std::string token_ = std::string(64, '7');
  const Guard::FindSession nobody_ = [](std::string_view) { return Guard::Found{}; };
  const Guard guard_{token_, {"127.0.0.1:8800", "localhost:8800"}, false};
};

/// What the launcher says of its faults' switches.
class FaultsEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    return {R"({"faults":[{"name":"silent-tello1","drone":"tello1","label":"Drone silent","words":"w","on":true}]})",
            R"({"faults":[]})"};
  }
  Outcome feed(std::string_view bytes) override { return outcome_of(faults_from(bytes)); }
};

const Registration request({"station.request", Kind::text, [] { return std::make_unique<RequestEntry>(); }});
const Registration stream({"station.stream", Kind::json, [] { return std::make_unique<StreamEntry>(); }});
const Registration faults({"station.faults", Kind::json, [] { return std::make_unique<FaultsEntry>(); }});
const Registration head({"station.head", Kind::text, [] { return std::make_unique<HeadEntry>(); }});

}  // namespace
}  // namespace ledgerline::fuzz::station_part
