#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "common/rt/trace.hpp"
#include "tests/fuzz/directory.hpp"
#include "tests/fuzz/entry.hpp"
#include "tools/launcher/live.hpp"
#include "tools/report/results.hpp"
#include "tools/timing/metrics.hpp"

/// What programs leave behind or say while they run, as the launcher and the report read it.
namespace ledgerline::fuzz::report_part {
namespace {

void write(const std::string& path, std::string_view bytes) {
  std::ofstream file(path, std::ios::binary);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

std::string trace_of(const std::vector<TraceRecord>& records) {
  const Directory directory;
  const std::string path = directory.path + "/t";
  {
    auto writer = TraceWriter::create(path);
    for (const TraceRecord& record : records) writer->add(record);
  }
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::vector<TraceRecord> some_records() {
  std::vector<TraceRecord> records;
  for (int i = 0; i < 6; ++i) {
    TraceRecord r;
    r.t_ns = 2 * ns_per_s + i * ns_per_ms;
    r.kind = i % 3 == 0 ? TraceKind::command_verified : i % 3 == 1 ? TraceKind::command_applied : TraceKind::truth;
    r.drone = 1;
    r.id = static_cast<std::uint64_t>(i);
    r.stamp_ns = 2 * ns_per_s;
    r.v[0] = r.v[1] = 1.5;
    records.push_back(r);
  }
  return records;
}

/// One file that a program left, spoilt, read as `fly` does at its end, and shown. The others are missing.
class RunEntry final : public Entry {
 public:
  RunEntry(std::string file, std::vector<std::string> seeds) : seeds_(std::move(seeds)) {
    files_.directory = directory_.path;
    file_ = files_.in(file);
    run_.begin_ns = ns_per_s;
    run_.end_ns = 11 * ns_per_s;
  }
  std::vector<std::string> seeds() override { return seeds_; }

  Outcome feed(std::string_view bytes) override {
    write(file_, bytes);
    const report::Results results = report::read_results(files_, {}, run_);
    // Showing costs ten times as much as reading.
    if (++read_ % 8 == 0 && (report::to_json(results).empty() || report::to_table(results).empty())) return refused("");
    const bool missing = std::find(results.missing.begin(), results.missing.end(), file_) != results.missing.end();
    return missing ? refused("missing: " + file_) : accepted();
  }

  static constexpr const char* node =
      R"({"blocks":12,"transactions":11,"invalid":0,"storage":"tmpfs","disk_ms":{"p5":1,"q1":2,"median":3,"q3":4,"p95":5,"p99":6,"max":7,"count":12}})";
  static constexpr const char* link =
      R"({"drones":[{"name":"tello1","states_lost":1,"commands_applied":7,"commands_late":1,"commands_dropped":2,"drop_reasons":{"not_flying":2}}]})";
  static constexpr const char* agent =
      R"({"drones":[{"name":"tello1","states":{"sampled":20,"sent":18,"on_ledger":17,"merged":2,"dropped":1},"commands":{"on_ledger":10,"refused":3,"refused_reasons":{"too_old":3}}}],"transactions":{"committed":17}})";
  static constexpr const char* ground =
      R"({"drones":[{"name":"tello1","finished":true,"landed":true,"lap_s":[12.5,13.5],"origin":[1.0,2.0],"height_m":1.0,"commands_sent":11,"commands_refused":1,"path_ns":[1000000000,9000000000]}],"transactions":{"committed":10},"why":""})";

 private:
  Directory directory_;
  std::string file_;
  std::vector<std::string> seeds_;
  launcher::RunFiles files_;
  launcher::RunRecord run_;
  int read_ = 0;
};

class TraceEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override { return {trace_of(some_records()), trace_of({})}; }
  Outcome feed(std::string_view bytes) override {
    const std::string path = directory_.path + "/t";
    write(path, bytes);
    const auto records = read_trace(path);
    if (!records) return refused(records.error().message);
    return records->size() <= bytes.size() / sizeof(TraceRecord) ? accepted() : refused("");
  }

 private:
  Directory directory_;
};

/// A flight's traces, spoilt, as `timing` reads them: one file for all three programs.
class WalksEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    std::vector<TraceRecord> records;
    for (std::uint16_t kind = 1; kind <= 20; ++kind) {
      TraceRecord r;
      r.t_ns = 2 * ns_per_s + kind * ns_per_ms;
      r.kind = static_cast<TraceKind>(kind);
      r.drone = 1;
      r.id = r.extra = 1;
      r.stamp_ns = 2 * ns_per_s;
      records.push_back(r);
    }
    return {trace_of(records)};
  }
  Outcome feed(std::string_view bytes) override {
    const std::string path = directory_.path + "/t";
    write(path, bytes);
    const auto records = read_trace(path);
    if (!records) return refused(records.error().message);
    timing::SampleTraces open;
    for (const auto writer : {timing::Writer::link, timing::Writer::agent, timing::Writer::ground})
      open.add(writer, *records);
    const auto traces = open.pop();
    if (++read_ % 8 != 0) return accepted();  // showing costs far more than reading
    std::ostringstream events;
    (void)timing::write_perfetto(events, traces, *records);
    const auto metrics = timing::make_metrics(traces, *records);
    return timing::to_table(metrics, 3).empty() || !nlohmann::json::accept(events.str()) ? refused("") : accepted();
  }

 private:
  Directory directory_;
  int read_ = 0;
};

class UsageEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    timing::UsageRecord record{{{"link", 5}}, {}, {}};
    record.end.threads.push_back({.program = "link", .name = "loop"});
    return {timing::to_json(record).dump()};
  }
  Outcome feed(std::string_view bytes) override {
    const auto record = timing::usage_from_json(std::string(bytes));
    if (!record) return refused(record.error().message);
    (void)timing::load_between(record->begin, record->end);
    return accepted();
  }
};

class LiveEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    return {
        R"({"agent":{"height":42,"drones":[{"name":"tello1","phase":"flying","mode":"none","position":[1.25,-2.5,1.0],"state_age_ms":7.0,"command_age_ms":12.0,"two_way_ms":15.0}]}})",
        R"({"ground":{"drones":[{"name":"tello1","phase":"path","lap":2,"progress":0.5}],"why":""}})",
        R"({"ready":true,"endpoint":"127.0.0.1:7051"})"};
  }
  Outcome feed(std::string_view bytes) override {
    const bool taken = live_.on_status(std::string(bytes));
    for (const std::string& line : live_.lines(ns_per_s)) {
      if (line.size() > 100'000) return refused("");
    }
    (void)live_.anything_in_air();
    return taken ? accepted() : dropped();
  }

 private:
  launcher::Live live_{{"tello1", "tello2"}, false, 0};
};

const Registration trace({"report.trace", Kind::bytes, [] { return std::make_unique<TraceEntry>(); }});
const Registration traces({"timing.walks", Kind::bytes, [] { return std::make_unique<WalksEntry>(); }, 0.02});
const Registration usage({"timing.usage", Kind::json, [] { return std::make_unique<UsageEntry>(); }});
const Registration live({"fly.status_line", Kind::json, [] { return std::make_unique<LiveEntry>(); }});

Registered run_file(const std::string& name, const std::string& file, Kind kind,
                    const std::vector<std::string>& seeds) {
  // A record holds numbers of any size: of a trace, only the length and the header can be wrong.
  return {"report." + name, kind, [=] { return std::make_unique<RunEntry>(file, seeds); }, 0.05};
}
const Registration node_summary(run_file("node_summary", "node.summary.json", Kind::json, {RunEntry::node}));
const Registration link_summary(run_file("link_summary", "link.summary.json", Kind::json, {RunEntry::link}));
const Registration agent_summary(run_file("agent_summary", "agent.summary.json", Kind::json, {RunEntry::agent}));
const Registration ground_summary(run_file("ground_summary", "ground.summary.json", Kind::json, {RunEntry::ground}));
const Registration agent_trace(run_file("agent_trace", "agent.trace", Kind::bytes, {trace_of(some_records())}));
const Registration sim_trace(run_file("sim_trace", "sim.trace", Kind::bytes, {trace_of(some_records())}));

}  // namespace
}  // namespace ledgerline::fuzz::report_part
