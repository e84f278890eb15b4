#include <cmath>

#include "onboard/link/core/tello/session.hpp"
#include "tests/fuzz/entry.hpp"

/// What a drone, or a client that pretends to be one, sends to link: state on port 8890, answers on 8889.
namespace ledgerline::fuzz::link_part {
namespace {

using namespace link;

const std::vector<std::string> states{
    "mid:-1;x:-100;y:-100;z:-100;mpry:-1,-1,-1;pitch:0;roll:0;yaw:-12;vgx:0;vgy:0;vgz:0;templ:60;temph:62;tof:10;h:0;"
    "bat:87;baro:147.94;time:0;agx:-5.00;agy:7.00;agz:-999.00;\r\n",
    "pitch:1;roll:-2;yaw:170;vgx:3;vgy:-1;vgz:0;templ:70;temph:73;tof:108;h:100;bat:55;baro:-102.87;time:31;agx:1.00;"
    "agy:-7.00;agz:-1001.00;\r\n",
    "h:30;tof:6553;bat:100;"};
const std::vector<std::string> answers{"ok",
                                       "OK\r\n",
                                       "error",
                                       "error Not joystick",
                                       "error Motor stop",
                                       "ok\0 ",
                                       "out of range",
                                       "unknown command: x",
                                       "error No valid imu"};
const std::vector<std::string> serials{"0TQDG00EDPMV39\r\n", "0TQDG00EDPMV40"};

Outcome state_alone(std::string_view bytes) {
  TelloState state{.height_m = 7, .tof_m = 8, .battery = 0.5F, .attitude_deg = {1, 2, 9}};
  if (!parse_state(bytes, state)) {
    const bool untouched =
        state.height_m == 7 && state.tof_m == 8 && state.battery == 0.5F && state.attitude_deg[2] == 9;
    return untouched ? dropped() : refused("");  // a refusal without a word is what the campaign fails on
  }
  const bool sane = std::abs(state.height_m) < 200 && state.tof_m >= 0 && state.tof_m < 100 && state.battery >= 0 &&
                    state.battery <= 1 && std::abs(state.attitude_deg[2]) <= 360;
  return sane ? accepted() : refused("");
}

Outcome answer_alone(std::string_view bytes) { return parse_answer(bytes) == Answer::unknown ? dropped() : accepted(); }

/// A session with a drone that says anything, while it is asked to fly and to land. The first byte says which port it
/// came to and what is asked for meanwhile.
class SessionEntry final : public Entry {
 public:
  explicit SessionEntry(std::string_view serial) : session_(SessionSettings{}, serial) {}

  std::vector<std::string> seeds() override {
    std::vector<std::string> all;
    for (const char request : {'a', 'b', 'c', 'd'}) {
      for (const std::string& state : states) all.push_back(std::string(1, request) + state);
    }
    for (const char request : {'A', 'B', 'C', 'D'}) {
      for (const std::string& answer : answers) all.push_back(std::string(1, request) + answer);
      for (const std::string& serial : serials) all.push_back(std::string(1, request) + serial);
    }
    return all;
  }
  std::vector<std::string> probes() override { return {"a" + states[0], "a" + states[1]}; }

  Outcome feed(std::string_view bytes) override {
    if (bytes.empty()) return dropped();
    const char first = bytes.front();
    bytes.remove_prefix(1);
    now_ += 20 * ns_per_ms;
    const std::uint32_t before = session_.states_refused() + session_.answers_unasked();
    if ((first & 0x20) != 0) {
      session_.on_state(now_, bytes);
    } else {
      session_.on_answer(now_, bytes);
    }
    switch (first & 3) {
      case 2:
        (void)session_.request_takeoff(now_);
        break;
      case 3:
        session_.request_land(now_);
        break;
      case 0:
        if ((now_ / ns_per_ms) % 7 == 0) session_.request_cut(now_);
        break;
      default:
        break;
    }
    CommandText text;
    int sent = 0;
    while (session_.next_send(now_, text)) {
      if (++sent > 4 || text.view().empty()) return refused("");
    }
    return session_.states_refused() + session_.answers_unasked() == before ? accepted() : dropped();
  }

 private:
  TimeNs now_ = ns_per_s;
  TelloSession session_;
};

const Registration state({"link.state", Kind::text, [] { return std::make_unique<Function>(states, state_alone); }});
const Registration answer({"link.answer", Kind::text,
                           [] { return std::make_unique<Function>(answers, answer_alone); }});
const Registration session({"link.session", Kind::text, [] { return std::make_unique<SessionEntry>(""); }});
const Registration session_of_one({"link.session_of_one", Kind::text,
                                   [] { return std::make_unique<SessionEntry>("0TQDG00EDPMV39"); }});

}  // namespace
}  // namespace ledgerline::fuzz::link_part
