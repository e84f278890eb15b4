// CPU of a small message's way through the bridge: its cores alone, off DDS's hands into the call and out of a block;
// then from DDS into the call. One thread, no ledger.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <mutex>
#include <thread>

#include "common/bridge/core/downlink.hpp"
#include "common/bridge/core/uplink.hpp"
#include "common/dds/dds.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::bridge;

const crypto::IdentityName here{"Org1MSP", "CN=here"}, there{"Org2MSP", "CN=there"};

constexpr const char* type = "geometry_msgs/msg/Twist";

struct Figures {
  TimeNs up_ns = 0, down_ns = 0;
  std::uint64_t messages = 0;
};

TimeNs cpu_ns() { return read_clock(CLOCK_THREAD_CPUTIME_ID); }

Rule rule_of_all() {
  Rule all;
  all.name = "/*";
  all.to_ledger = all.from_ledger = true;
  all.from = anybody;
  all.queue = 1'000;
  return all;
}

fabric::Outcome committed() {
  fabric::Outcome outcome;
  outcome.kind = fabric::Outcome::Kind::committed;
  return outcome;
}

std::vector<std::uint8_t> message_of(std::size_t size) {
  std::vector<std::uint8_t> message(size);
  message[1] = 1;  // CDR, little endian
  return message;
}

Figures measure(int topics, int per_call, int calls, std::size_t size) {
  const Rule all = rule_of_all();
  Uplink uplink({.rules = {all}, .enrolled = {}, .msp_id = here.msp_id, .writer = 1, .life = 1});
  const auto registry = crypto::make_test_registry({here.msp_id});
  Downlink downlink({.rules = {all}, .self = there, .writer = 2}, *registry);
  for (int topic = 0; topic < topics; ++topic) (void)uplink.open("/t" + std::to_string(topic), type);
  const auto message = message_of(size);
  agent::testing::LedgerOfTests ledger;
  std::vector<Downlink::Delivery> out;
  Figures figures;
  TimeNs now = 0;
  for (int call = -calls / 10; call < calls; ++call) {
    now += ns_per_s;
    const TimeNs begin = cpu_ns();
    for (int i = 0; i < per_call; ++i) uplink.add(now, static_cast<std::size_t>(i % topics), now, message);
    const auto submit = uplink.next(now);
    uplink.finished(now, submit->number, committed());
    const TimeNs up = cpu_ns();
    agent::testing::LedgerOfTests::Tx tx;
    tx.creator = here;
    tx.event_name = "set";
    tx.event_payload = submit->call.args[0];
    const fabric::Block block = ledger.block({tx});
    out.clear();
    const TimeNs block_made = cpu_ns();
    downlink.on_block(now, block, out);
    if (call < 0) continue;  // until everything has its size
    figures.up_ns += up - begin;
    figures.down_ns += cpu_ns() - block_made;
    figures.messages += out.size();
  }
  return figures;
}

/// Of a message.
struct ThroughDds {
  double written_us = 0;  ///< writing it, while nobody reads
  double carried_us = 0;  ///< writing it, and all until it is in the bytes of a call
};

/// Two participants of one process: the call that writes also takes, on the same thread.
Result<ThroughDds> measure_through_dds(std::uint32_t domain, int messages, int per_call, std::size_t size) {
  auto out = dds::Participant::create({.domain = domain}), in = dds::Participant::create({.domain = domain});
  if (!out || !in) return (out ? in : out).error();
  auto writer = dds::RawWriter::create(*out, "/bench", type, {});
  if (!writer) return writer.error();
  const auto message = message_of(size);
  const auto write_all = [&]() -> Result<double> {
    const TimeNs begin = cpu_ns();
    for (int i = 0; i < messages; ++i) {
      if (auto status = writer->publish(message); !status) return status.error();
    }
    return 1e3 * to_ms(cpu_ns() - begin) / messages;
  };
  const auto written = write_all();
  if (!written) return written.error();

  Uplink uplink(
      {.rules = {rule_of_all()}, .enrolled = {}, .msp_id = here.msp_id, .writer = 1, .life = 1, .min_gap_ns = 0});
  const std::size_t topic = *uplink.open("/bench", type);
  std::mutex mutex;
  bool one_thread = true;
  auto reader = dds::RawReader::create(
      *in, "/bench", type, {},
      [&, writes = std::this_thread::get_id()](std::span<const std::uint8_t> cdr, const dds::RawInfo& info) {
        const std::lock_guard lock(mutex);
        one_thread = one_thread && std::this_thread::get_id() == writes;
        uplink.add(monotonic_ns(), topic, info.source_time_ns, cdr);
        if (uplink.topics()[topic].counters.pending < static_cast<std::uint64_t>(per_call)) return;
        const auto submit = uplink.next(monotonic_ns());
        uplink.finished(monotonic_ns(), submit->number, committed());
      });
  if (!reader) return reader.error();
  while (writer->readers() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  const auto carried = write_all();
  if (!carried) return carried.error();
  const auto came = uplink.topics()[topic].counters.taken;
  if (came != static_cast<std::uint64_t>(messages)) return Error{fmt::format("{} of {} messages came", came, messages)};
  if (!one_thread) return Error{"DDS took them on a thread of its own, whose CPU is not measured"};
  return ThroughDds{*written, *carried};
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"CPU per message in the bridge's cores.", "bench_bridge"};
  int calls = 2'000;
  std::size_t size = 200;
  app.add_option("--calls", calls, "Of each kind")->check(CLI::Range(10, 1'000'000))->capture_default_str();
  int messages = 100'000;
  std::uint32_t domain = 42;
  app.add_option("--messages", messages, "Through DDS, of each kind")
      ->check(CLI::Range(1'000, 10'000'000))
      ->capture_default_str();
  app.add_option("--domain", domain, "Of DDS")->capture_default_str();
  app.add_option("--size", size, "Bytes of a message")->check(CLI::Range(4, 8'000))->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  fmt::print("{:<10}{:>16}{:>20}{:>22}\n", "topics", "messages a call", "DDS to call, us", "block to DDS, us");
  for (const auto& [topics, per_call] : {std::pair(1, 1), std::pair(20, 20), std::pair(20, 500), std::pair(256, 500)}) {
    const Figures f = measure(topics, per_call, calls, size);
    const auto each = [&](TimeNs ns) { return 1e3 * to_ms(ns) / static_cast<double>(f.messages); };
    fmt::print("{:<10}{:>16}{:>20.2f}{:>22.2f}\n", topics, per_call, each(f.up_ns), each(f.down_ns));
  }
  fmt::print("\n{:<10}{:>16}{:>20}{:>22}\n", "", "messages a call", "written alone, us", "DDS to call, us");
  for (const int per_call : {1, 20, 500}) {
    const auto f = measure_through_dds(domain, messages, per_call, size);
    if (!f) {
      fmt::print(stderr, "{}\n", f.error().message);
      return 1;
    }
    fmt::print("{:<10}{:>16}{:>20.2f}{:>22.2f}\n", "", per_call, f->written_us, f->carried_us);
  }
  return 0;
}
