#include "sim/core/simulator.hpp"
#include "tests/fuzz/entry.hpp"

/// Port 8889 of a simulated drone.
namespace ledgerline::fuzz::sim_part {
namespace {

constexpr sim::Endpoint client{0x0a000001, 40000};

class SdkEntry final : public Entry {
 public:
  /// Without command mode nothing but `command` is heard.
  explicit SdkEntry(bool command_mode) : command_mode_(command_mode) {
    sim::Parameters parameters;
    parameters.mocap_hz = 0;
    simulator_ = std::make_unique<sim::Simulator>(parameters, 0);
    if (command_mode_) {
      (void)feed("command");
      (void)feed("takeoff");
    }
  }

  std::vector<std::string> seeds() override {
    std::vector<std::string> all{"command",
                                 "takeoff",
                                 "land",
                                 "emergency",
                                 "stop",
                                 "up 50",
                                 "down 20",
                                 "left 500",
                                 "right 21",
                                 "forward 100",
                                 "back 30",
                                 "cw 90",
                                 "ccw 360",
                                 "go 50 60 70 30",
                                 "speed 100",
                                 "flip l",
                                 "flip b",
                                 "rc 10 -20 30 -100",
                                 "rc 0 0 0 0",
                                 "mon",
                                 "moff",
                                 "mdirection 2",
                                 "keepalive",
                                 "streamon",
                                 "streamoff",
                                 "motoron",
                                 "motoroff",
                                 "throwfly",
                                 "setfps high",
                                 "setbitrate 3",
                                 "port 8891 11112",
                                 "downvision 1",
                                 "ap name pass",
                                 "wifi a b",
                                 "EXT led 1 2 3",
                                 "reboot",
                                 "battery?",
                                 "speed?",
                                 "time?",
                                 "wifi?",
                                 "sdk?",
                                 "sn?",
                                 "height?",
                                 "temp?",
                                 "attitude?",
                                 "baro?",
                                 "acceleration?",
                                 "tof?",
                                 "hardware?",
                                 "active?",
                                 "ssid?",
                                 "ap?",
                                 "go 50 60 70 30 m1",
                                 "curve 100 100 0 200 0 0 60",
                                 "curve 50 50 10 100 0 20 30 m8",
                                 "jump 100 0 0 50 90 m1 m2"};
    return all;
  }
  std::vector<std::string> probes() override {
    if (!command_mode_) return {};
    return {"command", "battery?", "sdk?", "rc 0 0 0 0", "speed 50"};
  }

  Outcome feed(std::string_view bytes) override {
    simulator_->datagram(1, client, bytes);
    const auto* out = &simulator_->step(now_);
    // An answer comes at once, or when the move ends; one pass of the clock is enough for the former.
    std::string answer;
    int answers = 0;
    for (int pass = 0; pass < 2; ++pass) {
      for (const sim::Outgoing& datagram : out->datagrams) {
        if (datagram.to != client) continue;
        answer = datagram.bytes;
        ++answers;
      }
      if (pass == 0) out = &simulator_->step(now_ += ns_per_ms);
    }
    const bool silent_by_rule = answers == 0;
    if (!command_mode_ && answers > 0) {
      // Heard it: that must have been `command`; back to a drone that was just switched on.
      (void)feed_quietly("reboot");
      return accepted();
    }
    if (silent_by_rule) return bytes.substr(0, 2) == "rc" || waits(bytes) ? accepted() : dropped();
    if (answer.rfind("error", 0) == 0 || answer.rfind("out of range", 0) == 0 || answer.rfind("unknown", 0) == 0) {
      return refused(answer);
    }
    return accepted();
  }

 private:
  Outcome feed_quietly(std::string_view bytes) {
    simulator_->datagram(1, client, bytes);
    (void)simulator_->step(now_ += ns_per_ms);
    return accepted();
  }
  /// Commands whose answer comes at their end, and those that are never answered.
  static bool waits(std::string_view bytes) {
    for (const char* word : {"takeoff", "land", "up ", "down ", "left ", "right ", "forward ", "back ", "cw ", "ccw ",
                             "go ", "curve ", "flip ", "reboot"}) {
      if (bytes.substr(0, std::string_view(word).size()) == word) return true;
    }
    return false;
  }

  bool command_mode_;
  TimeNs now_ = 0;
  std::unique_ptr<sim::Simulator> simulator_;
};

const Registration sdk({"sim.sdk", Kind::text, [] { return std::make_unique<SdkEntry>(true); }});
const Registration cold({"sim.sdk_before_command", Kind::text, [] { return std::make_unique<SdkEntry>(false); }});

}  // namespace
}  // namespace ledgerline::fuzz::sim_part
