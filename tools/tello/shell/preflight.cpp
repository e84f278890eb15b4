#include "tools/tello/shell/preflight.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>

#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/dds/dds.hpp"
#include "common/dds/raw.hpp"
#include "common/msg/names.hpp"
#include "common/msg/ros.hpp"
#include "common/process/children.hpp"
#include "common/program/program.hpp"
#include "common/rt/spsc_ring.hpp"
#include "onboard/link/shell/transport/udp.hpp"
#include "tools/checks/shell/host_probe.hpp"
#include "tools/launcher/preflight.hpp"
#include "tools/tello/core/reception.hpp"
#include "tools/tello/shell/talk.hpp"

namespace ledgerline::tello {
namespace {

namespace fs = std::filesystem;

// A peer answers within the 5 s that control gives it, or not at all.
constexpr TimeNs records_limit_ns = 10 * ns_per_s;
constexpr TimeNs timeout_ns = ns_per_s;

using Ring = SpscRing<ReceivedPose, 256>;  // a second at 250 Hz; the loop empties it each 4 ms

/// The topic of one drone's poses.
struct Poses {
  std::unique_ptr<Ring> ring = std::make_unique<Ring>();
  std::optional<dds::RawReader> reader{};  ///< ends before the ring that it fills
};

Result<std::vector<Poses>> subscribe(const launcher::Options& flight) {
  std::vector<Poses> all;
  if (flight.own->pose_topic.empty()) return all;
  dds::ParticipantOptions options{
      .ros_release = flight.ros_release, .cyclonedds = flight.cyclonedds, .node = "ledgerline_tello"};
  if (flight.cyclonedds.empty()) options.local_only = true;  // as fly has it
  if (!flight.domains.empty()) options.domain = static_cast<std::uint32_t>(flight.domains.front());
  auto participant = dds::Participant::create(options);
  if (!participant) return participant.error();
  for (const deployment::OwnDrone& drone : flight.own->drones) {
    Poses poses;
    auto made = dds::RawReader::create(
        *participant, pose_topic_of(flight.own->pose_topic, drone.name), std::string(pose_type), {.reliable = false},
        [ring = poses.ring.get()](std::span<const std::uint8_t> cdr, const dds::RawInfo&) {
          const auto pose = pose_from_cdr(dds::text_of(cdr));
          // One that does not fit is as one that DDS lost.
          if (pose) (void)ring->push(ReceivedPose::of(realtime_ns(), *pose));
        });
    if (!made) return made.error();
    poses.reader.emplace(std::move(*made));
    all.push_back(std::move(poses));
  }
  return all;
}

/// Drones behind one interface, which have addresses of their own there.
struct Side {
  std::vector<std::size_t> indices;  ///< in the inputs
  std::vector<Found> asked;
  link::Descriptor states;
};

Status query_all(std::map<std::string, Side>& sides, checks::PreflightInputs& inputs) {
  for (auto& [interface, side] : sides) {
    if (auto status = query(side.asked, interface); !status) return status;
    for (std::size_t i = 0; i < side.indices.size(); ++i) {
      checks::DroneInputs& drone = inputs.drones[side.indices[i]];
      const Dialogue& dialogue = side.asked[i].dialogue;
      drone.there = dialogue.present();
      drone.serial = dialogue.answer("sn?");
      const std::string battery = dialogue.answer("battery?");
      if (!battery.empty()) drone.battery = std::stod(battery) / 100;  // Asking has seen that it is a number
    }
  }
  return done;
}

// What waited while others were asked would count as if it had come at once.
void forget_what_waits(const link::Descriptor& states) {
  bool some = true;
  for (int rounds = 0; some && rounds < 100; ++rounds) {  // a flood ends it, too
    some = false;
    read_all(states.get(), [&some](std::uint32_t, std::string_view) { some = true; });
  }
}

Status listen(std::map<std::string, Side>& sides, std::vector<Poses>& poses, const PreflightOptions& options,
              checks::PreflightInputs& inputs) {
  std::vector<Reception> reception(inputs.drones.size());
  for (const auto& [interface, side] : sides) forget_what_waits(side.states);
  for (Poses& of_one : poses)
    for (ReceivedPose old; of_one.ring->pop(old);) continue;
  for (const TimeNs end = monotonic_ns() + from_seconds(options.listen_s); monotonic_ns() < end && !stop_requested;) {
    wait({});
    for (auto& [interface, side] : sides) {
      read_all(side.states.get(), [&side = side, &reception](std::uint32_t from, std::string_view bytes) {
        for (std::size_t i = 0; i < side.indices.size(); ++i)
          if (side.asked[i].address == from) reception[side.indices[i]].on_state(monotonic_ns(), bytes);
      });
    }
    for (std::size_t i = 0; i < poses.size(); ++i)
      for (ReceivedPose heard; poses[i].ring->pop(heard);) reception[i].on_pose(heard);
  }
  for (std::size_t i = 0; i < reception.size(); ++i) {
    reception[i].report(monotonic_ns(), realtime_ns(), inputs.stamps_count, inputs.drones[i]);
    // By onboard odometry a drone is where the file says that it stands.
    const auto source = from_name<link::PoseSource>(inputs.pose_source);
    if (source && !link::uses_mocap(*source))
      inputs.drones[i].pose = checks::PoseInputs{.position_m = options.flight.own->drones[i].start_m};
  }
  if (stop_requested) return Error{"it was asked to end"};
  return done;
}

/// A folder that nobody else can read, for as long as it lives.
class OwnFolder {
 public:
  OwnFolder() : path_((fs::temp_directory_path() / "ledgerline-preflight-XXXXXX").string()) {
    made_ = ::mkdtemp(path_.data()) != nullptr;
  }
  ~OwnFolder() {
    std::error_code error;  // what stays is a file of paths
    if (made_) fs::remove_all(path_, error);
  }
  OwnFolder(const OwnFolder&) = delete;
  OwnFolder& operator=(const OwnFolder&) = delete;
  bool made() const { return made_; }
  std::string in(const char* name) const { return path_ + "/" + name; }

 private:
  std::string path_;
  bool made_ = false;
};

// By a program of its own, so that this one is without gRPC's threads.
Status read_records(const PreflightOptions& options, checks::PreflightInputs& inputs) {
  const deployment::OwnLedger& network = *options.flight.own->network;
  const auto self = crypto::load_identity(crypto::Library::libcrypto, network.ground_msp_id, network.ground_files);
  if (!self) return self.error();
  const OwnFolder folder;
  if (!folder.made()) return Error{fmt::format("no folder for a moment can be made: {}", std::strerror(errno))};
  if (auto s = write_file(folder.in("ledger.toml"), network.pilot, 0600); !s) return s;
  std::string records;
  Children children([&records](const std::string&, const std::string& line) { records = line; });
  const std::string name = "control";
  const std::vector<std::string> command{options.ledgerline,       "control", "--config",
                                         folder.in("ledger.toml"), "show",    "--json"};
  if (auto s = children.start({name, command, folder.in("log"), SIGKILL}); !s) return s;
  for (const TimeNs end = monotonic_ns() + records_limit_ns; children.is_running(name) && !stop_requested;) {
    if (monotonic_ns() > end) break;
    children.poll(50 * ns_per_ms);
  }
  if (children.is_running(name)) {
    (void)children.stop(name, timeout_ns);
    return Error{fmt::format("it did not answer within {:.0f} s", to_seconds(records_limit_ns))};
  }
  if (!children.has_succeeded(name)) return Error{printable(children.log_tail(name, 1))};
  return launcher::read_records(records, self->name, inputs);
}

void query_ledger(const PreflightOptions& options, checks::PreflightInputs& inputs) {
  if (!options.flight.own->network) return;
  const Status status = read_records(options, inputs);
  inputs.ledger.state = status ? checks::LedgerInputs::State::reached : checks::LedgerInputs::State::failed;
  if (!status) inputs.ledger.what = status.error().message;
}

}  // namespace

Result<checks::PreflightInputs> probe_flight(const PreflightOptions& options) {
  catch_stop_signals();
  checks::PreflightInputs inputs = launcher::inputs_of(options.flight);
  query_ledger(options, inputs);  // first: it starts a process, and DDS starts threads
  std::map<std::string, Side> sides;
  for (std::size_t i = 0; i < inputs.drones.size(); ++i) {
    const auto address = parse_ipv4(inputs.drones[i].address);
    if (!address) return address.error();
    Side& side = sides[inputs.drones[i].interface];
    side.indices.push_back(i);
    side.asked.push_back({*address, Dialogue({"sn?", "battery?"})});
  }
  for (auto& [interface, side] : sides) {
    auto states = link::open_udp(interface);
    if (!states) return states.error();
    side.states = std::move(*states);
    if (!link::listen_alone(side.states, socket_address(INADDR_ANY, state_port)))
      return Error{
          "another program listens to state text on port 8890 here: is it ledgerline-link? Not while it flies"};
  }
  auto poses = subscribe(options.flight);
  if (!poses) return poses.error();
  if (auto status = query_all(sides, inputs); !status) return status.error();
  if (auto status = listen(sides, *poses, options, inputs); !status) return status.error();
  inputs.clock = checks::probe_clock();
  inputs.path = launcher::check_path(options.flight, inputs);
  return inputs;
}

}  // namespace ledgerline::tello
