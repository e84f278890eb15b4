// What a small message costs the process that hears it: ours (raw CDR) beside a plain reader of Cyclone DDS with the
// type compiled in, in turns, from a publisher in another process. All of the process's CPU time counts, sockets
// included.
#include <dds/dds.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <optional>
#include <thread>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/msg/cdr.hpp"
#include "dds_types.h"

namespace {

using namespace ledgerline;

constexpr const char* topic = "/bench/twist";
constexpr const char* type = "geometry_msgs/msg/Twist";
constexpr auto period = std::chrono::microseconds(500);

std::atomic<std::uint64_t> heard{0};

/// Until it is ended.
int publish(std::uint32_t domain) {
  auto participant = dds::Participant::create({.domain = domain});
  if (!participant) return 1;
  auto writer = dds::RawWriter::create(*participant, topic, type, {});
  if (!writer) return 1;
  CdrWriter cdr;
  cdr.put(std::array<double, 6>{1, 2, 3, 4, 5, 6});
  const std::string message = cdr.release();
  for (auto next = std::chrono::steady_clock::now();; next += period) {
    (void)writer->publish(message);
    std::this_thread::sleep_until(next);
  }
}

/// Microseconds of CPU for each of `messages`.
double measure(std::uint64_t messages) {
  const auto wait_for = [](std::uint64_t count) {
    while (heard < count) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  };
  wait_for(heard + 200);
  const std::uint64_t first = heard;
  const TimeNs begin = read_clock(CLOCK_PROCESS_CPUTIME_ID);
  wait_for(first + messages);
  const TimeNs cpu = read_clock(CLOCK_PROCESS_CPUTIME_ID) - begin;
  return static_cast<double>(cpu) / 1e3 / static_cast<double>(heard - first);
}

void take_typed(dds_entity_t reader, void*) {
  void* samples[16] = {};
  dds_sample_info_t infos[16];
  const dds_return_t count = dds_take(reader, samples, infos, 16, 16);
  for (dds_return_t i = 0; i < count; ++i) {
    if (infos[i].valid_data) ++heard;
  }
  if (count > 0) (void)dds_return_loan(reader, samples, count);
}

double typed(const dds::ParticipantPtr& participant, std::uint64_t messages) {
  const dds_entity_t t =
      dds_create_topic(participant->handle(), &geometry_msgs_msg_dds__Twist__desc, "rt/bench/twist", nullptr, nullptr);
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  dds_listener_t* listener = dds_create_listener(nullptr);
  dds_lset_data_available(listener, take_typed);
  const dds_entity_t reader = dds_create_reader(participant->handle(), t, qos, listener);
  const double cost = measure(messages);
  dds_delete(reader);
  dds_delete(t);
  dds_delete_listener(listener);
  dds_delete_qos(qos);
  return cost;
}

double raw(const dds::ParticipantPtr& participant, std::uint64_t messages) {
  auto reader = dds::RawReader::create(participant, topic, type, {},
                                       [](std::span<const std::uint8_t>, const dds::RawInfo&) { ++heard; });
  if (!reader) throw std::runtime_error(reader.error().message);
  return measure(messages);
}

void print(const char* what, std::vector<double> costs) {
  std::sort(costs.begin(), costs.end());
  fmt::print("{:<34} median {:>6.2f}  min {:>6.2f}  max {:>6.2f} us of CPU a message\n", what, costs[costs.size() / 2],
             costs.front(), costs.back());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("CPU of a small message from DDS to the callback, beside a plain typed reader");
  int turns = 5;
  std::uint64_t messages = 4000;
  std::uint32_t domain = 42;
  app.add_option("--turns", turns, "of each of the two")->capture_default_str();
  app.add_option("--messages", messages, "a turn, at 2,000 a second")->capture_default_str();
  app.add_option("--domain", domain, "of DDS")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const pid_t publisher = fork();
  if (publisher == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    _exit(publish(domain));
  }
  std::vector<double> ours, plain;
  {
    auto participant = dds::Participant::create({.domain = domain});
    if (!participant) {
      fmt::print(stderr, "{}\n", participant.error().message);
      return 1;
    }
    for (int i = 0; i < turns; ++i) {
      ours.push_back(raw(*participant, messages));
      plain.push_back(typed(*participant, messages));
    }
  }
  print("raw CDR (common/dds)", ours);
  print("typed, plain Cyclone DDS", plain);
  kill(publisher, SIGKILL);
  waitpid(publisher, nullptr, 0);
}
