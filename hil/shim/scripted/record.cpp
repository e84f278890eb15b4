#include "hil/shim/scripted/record.hpp"

#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "common/base/file.hpp"
#include "common/base/printable.hpp"
#include "common/msg/names.hpp"

namespace ledgerline::hil::shim {

void Record::sent(TimeNs now, DroneNumber drone, std::string_view bytes) {
  constexpr std::size_t max_text = 200;
  const std::string line =
      fmt::format("{:.6f},tello{},{}\n", to_seconds(now - begin_ns_), drone, printable(bytes, max_text));
  digester_.put(line);
  if (++count_ <= max_lines) lines_ += line;
}

Status Record::write_datagrams(const std::string& path) const {
  if (count_ > max_lines)
    return Error{fmt::format("{}: {} datagrams, of which {} at most can be written", path, count_, max_lines)};
  return write_file(path, lines_);
}

Status Record::write_summary(TimeNs now, const std::vector<Transition>& transitions, const sim::Simulator& drones,
                             const SdkFaults::Counts& sdk, const std::string& path) {
  nlohmann::json summary{{"begin_ns", begin_ns_},
                         {"flown_s", to_seconds(now - begin_ns_)},
                         {"sent", count_},
                         {"sent_digest", crypto::hex(digester_.result())},
                         {"transitions", nlohmann::json::array()},
                         {"sdk", {{"answers", sdk.answers}, {"states", sdk.states}, {"no_room", sdk.no_room}}},
                         {"drones", nlohmann::json::array()}};
  for (const Transition& t : transitions) {
    summary["transitions"].push_back({{"s", to_seconds(t.stamp_ns - begin_ns_)},
                                      {"drone", fmt::format("tello{}", t.drone)},
                                      {"phase", name(t.phase)},
                                      {"mode", name(t.mode)},
                                      {"cause", name(t.cause)}});
  }
  for (std::size_t i = 0; i < sdk.struck.size(); ++i) {
    const auto kind = static_cast<SdkFault::Kind>(i);
    summary["sdk"][fmt::format("{}_{}", of_states(kind) ? "states" : "answers", name_of(kind))] = sdk.struck[i];
  }
  for (int k = 1; k <= drones.drones(); ++k) {
    const sim::Truth truth = drones.truth(static_cast<DroneNumber>(k));
    summary["drones"].push_back({{"name", fmt::format("tello{}", k)},
                                 {"position_m", truth.position_m},
                                 {"motors_on", truth.motors_on},
                                 {"crashed", truth.crashed}});
  }
  std::puts(summary.dump().c_str());
  std::fflush(stdout);
  return path.empty() ? Status(done) : write_file(path, summary.dump(2) + "\n");
}

}  // namespace ledgerline::hil::shim
