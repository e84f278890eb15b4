#include <fmt/format.h>
#include <readerwriterqueue/readerwriterqueue.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "common/rt/histogram.hpp"
#include "common/rt/spsc_ring.hpp"
#include "onboard/ipc/ipc.hpp"
#include "tests/benchmarks/rounds.hpp"
#include "tests/unit/child.hpp"
#include "tools/launcher/machine.hpp"

/// What it costs to hand a state over, and a pose back: through SpscRing and readerwriterqueue between threads, and
/// through iceoryx as link and agent use it between processes. All three take turns in one run, each round in another
/// order, so that what else the machine does meets them alike.
namespace {

using namespace ledgerline;

constexpr std::size_t capacity = 256;

struct Ring {
  static constexpr const char* name = "SpscRing";
  bool send(const StateSample& state) { return there.push(state); }
  bool receive(StateSample& state) { return there.pop(state); }
  bool answer(const Pose& pose) { return back.push(pose); }
  bool take_answer(Pose& pose) { return back.pop(pose); }
  SpscRing<StateSample, capacity> there;
  SpscRing<Pose, capacity> back;
};

struct ReaderWriterQueue {
  static constexpr const char* name = "readerwriterqueue";
  bool send(const StateSample& state) { return there.try_enqueue(state); }
  bool receive(StateSample& state) { return there.try_dequeue(state); }
  bool answer(const Pose& pose) { return back.try_enqueue(pose); }
  bool take_answer(Pose& pose) { return back.try_dequeue(pose); }
  moodycamel::ReaderWriterQueue<StateSample> there{capacity};
  moodycamel::ReaderWriterQueue<Pose> back{capacity};
};

struct Iceoryx {
  static constexpr const char* name = "iceoryx";
  bool send(const StateSample& state) { return link->send_state(state); }
  bool receive(StateSample& state) { return agent->receive_state(state); }
  bool answer(const Pose& pose) { return agent->send_pose(pose); }
  bool take_answer(Pose& pose) { return link->receive_pose(pose); }
  std::unique_ptr<ipc::LinkEnd> link;
  std::unique_ptr<ipc::AgentEnd> agent;
};

[[noreturn]] void give_up(const std::string& why) {
  fmt::print(stderr, "{}\n", why);
  std::exit(1);
}

/// Send and receive in one thread: what the calls themselves cost.
template <typename Way>
double alone_ns(Way& way, int messages) {
  StateSample state;
  const TimeNs begin = monotonic_ns();
  for (int i = 0; i < messages; ++i) {
    state.sequence = static_cast<std::uint64_t>(i);
    if (!way.send(state) || !way.receive(state)) give_up(fmt::format("{} lost a message", Way::name));
  }
  return static_cast<double>(monotonic_ns() - begin) / messages;
}

/// There and back between two threads that look without pause.
template <typename Way>
double round_trip_ns(Way& way, int messages) {
  std::atomic<bool> stop{false};
  std::thread other([&] {
    StateSample state;
    Pose pose;
    while (!stop.load(std::memory_order_relaxed)) {
      if (!way.receive(state)) continue;
      pose.stamp_ns = state.stamp_ns;
      if (!way.answer(pose)) give_up(fmt::format("{} lost a message", Way::name));
    }
  });
  StateSample state;
  Pose pose;
  const TimeNs begin = monotonic_ns();
  for (int i = 1; i <= messages; ++i) {
    state.stamp_ns = i;
    if (!way.send(state)) give_up(fmt::format("{} lost a message", Way::name));
    do {
      while (!way.take_answer(pose)) {
      }
    } while (pose.stamp_ns != i);
  }
  const double took_ns = static_cast<double>(monotonic_ns() - begin) / messages;
  stop = true;
  other.join();
  return took_ns;
}

/// One figure of each round, and what it is to SpscRing's of the same round.
struct Figures {
  std::vector<double> ns, ratio;
};

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "What handing a message over costs: SpscRing, readerwriterqueue, iceoryx.\n\nExample:\n"
      "  scripts/isolated build/release/bin/bench_rings"};
  std::string roudi_program = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "ledgerline-roudi", json;
  int rounds = 60, messages = 20'000;
  app.add_option("--roudi", roudi_program, "ledgerline-roudi")->check(CLI::ExistingFile)->capture_default_str();
  app.add_option("--rounds", rounds, "How often all take their turn")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--messages", messages, "A turn")->check(CLI::PositiveNumber)->capture_default_str();
  app.add_option("--json", json, "Where the figures go as one object");
  CLI11_PARSE(app, argc, argv);

  Child roudi;
  if (!roudi.start({roudi_program})) give_up("ledgerline-roudi does not start");
  if (auto status = ipc::connect("bench-rings"); !status) give_up(status.error().message);
  auto link = ipc::LinkEnd::create();
  auto agent = ipc::AgentEnd::create();
  if (!link || !agent) give_up("no end of the shared memory");
  auto ring = std::make_unique<Ring>();
  ReaderWriterQueue queue;
  Iceoryx iceoryx{std::move(*link), std::move(*agent)};
  StateSample state;
  Pose pose;
  while (!iceoryx.send(state) || !iceoryx.receive(state)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  while (!iceoryx.answer(pose) || !iceoryx.take_answer(pose)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  while (iceoryx.receive(state) || iceoryx.take_answer(pose)) {
  }

  constexpr std::array names{Ring::name, ReaderWriterQueue::name, Iceoryx::name};
  std::array<Figures, 3> alone, round_trip;
  const double load_before = load_average();
  for (int round = 0; round < rounds; ++round) {
    std::array<double, 3> alone_took{}, round_trip_took{};
    for (int turn = 0; turn < 3; ++turn) {
      const auto which = static_cast<std::size_t>((round + turn) % 3);
      const auto measure = [&](auto& way) {
        alone_took[which] = alone_ns(way, messages);
        round_trip_took[which] = round_trip_ns(way, messages);
      };
      if (which == 0) measure(*ring);
      if (which == 1) measure(queue);
      if (which == 2) measure(iceoryx);
    }
    for (std::size_t which = 0; which < 3; ++which) {
      alone[which].ns.push_back(alone_took[which]);
      alone[which].ratio.push_back(alone_took[which] / alone_took[0]);
      round_trip[which].ns.push_back(round_trip_took[which]);
      round_trip[which].ratio.push_back(round_trip_took[which] / round_trip_took[0]);
    }
  }

  nlohmann::json figures;
  fmt::print("{} rounds of {} messages; median (quartiles), ratios round by round; load {:.1f} before, {:.1f} after\n",
             rounds, messages, load_before, load_average());
  const std::pair<const char*, const std::array<Figures, 3>*> kinds[] = {{"one_thread", &alone},
                                                                         {"round_trip", &round_trip}};
  for (const auto& [kind, measured] : kinds) {
    fmt::print("  {:<30}{:>10}{:>20}{:>12}{:>20}\n",
               kind == kinds[0].first ? "send and receive, one thread" : "round trip, two threads", "ns", "", "ratio",
               "");
    for (std::size_t which = 0; which < 3; ++which) {
      const Quartiles ns = quartiles((*measured)[which].ns), ratio = quartiles((*measured)[which].ratio);
      fmt::print("  {:<30}{:>10.0f}{:>20}{:>12.2f}{:>20}\n", names[which], ns.median,
                 fmt::format("({:.0f} to {:.0f})", ns.q1, ns.q3), ratio.median,
                 fmt::format("({:.2f} to {:.2f})", ratio.q1, ratio.q3));
      figures[kind][names[which]] = {{"ns", ns}, {"ratio", ratio}};
    }
  }
  roudi.end(SIGTERM);
  if (json.empty()) return 0;
  const launcher::Machine machine = launcher::describe_machine();
  std::ofstream file(json);
  file << nlohmann::json{{"asked", {{"rounds", rounds}, {"messages", messages}}},
                         {"machine", {{"cpu", machine.cpu}, {"cores", machine.cores}, {"system", machine.system}}},
                         {"load", {{"before", load_before}, {"after", load_average()}}},
                         {"figures", figures}}
              .dump(2)
       << '\n';
  file.close();
  if (!file) give_up("cannot write " + json);
}
