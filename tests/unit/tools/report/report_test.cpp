#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "tools/report/results.hpp"

namespace ledgerline::report {
namespace {

using nlohmann::json;
using testing::HasSubstr;

TraceRecord record(TraceKind kind, TimeNs t_ns, std::uint16_t drone, std::uint64_t id, TimeNs stamp_ns, double x = 0,
                   double y = 0) {
  TraceRecord r;
  r.t_ns = t_ns;
  r.kind = kind;
  r.drone = drone;
  r.id = id;
  r.stamp_ns = stamp_ns;
  r.v[0] = x;
  r.v[1] = y;
  return r;
}

TEST(Report, LatencyIsFromEachCommandsStampToItsFirstRecordPerDrone) {
  const std::vector<TraceRecord> trace{
      record(TraceKind::command_verified, 110 * ns_per_ms, 1, 1, 100 * ns_per_ms),
      record(TraceKind::command_verified, 150 * ns_per_ms, 1, 1, 100 * ns_per_ms),
      record(TraceKind::command_verified, 160 * ns_per_ms, 2, 1, 100 * ns_per_ms),
      record(TraceKind::refused, 170 * ns_per_ms, 1, 2, 100 * ns_per_ms),
  };
  const auto samples = latencies(trace, TraceKind::command_verified, 1, 10 * ns_per_ms);
  ASSERT_EQ(samples.size(), 1u);
  EXPECT_NEAR(samples[0].ms, 10, 1e-9);
  EXPECT_NEAR(samples[0].t_s, 0.1, 1e-9);
}

TEST(Report, MomentsAreWhereLinkReportedADroneWithItsSpeed) {
  std::vector<TraceRecord> link;
  for (int i = 0; i <= 30; ++i) {
    link.push_back(record(TraceKind::state_sampled, (100 + 50 * i) * ns_per_ms, 1, i, 0, 0.05 * i));
    link.push_back(record(TraceKind::state_sampled, (100 + 50 * i) * ns_per_ms, 2, i, 0, 7));
  }
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  link.push_back(record(TraceKind::state_sampled, 1700 * ns_per_ms, 1, 31, 0, unknown, unknown));
  link.back().v[2] = 0.8;
  link.back().extra = 730;
  const auto moments = flown_moments(link, 1, 100 * ns_per_ms, 1800 * ns_per_ms);
  ASSERT_EQ(moments.size(), 32u);
  EXPECT_DOUBLE_EQ(moments.front().t_s, 0);
  EXPECT_EQ(moments[2].speed_mps, 0) << "not known yet";
  EXPECT_NEAR(moments[30].speed_mps, 1.0, 1e-9);
  EXPECT_NEAR(moments[30].position_m[0], 1.5, 1e-9);
  EXPECT_EQ(moments.back().position_m[2], 0.8) << "without a pose its own height is known";
  EXPECT_TRUE(std::isnan(moments.back().speed_mps));
  EXPECT_DOUBLE_EQ(moments.back().battery, 0.73);
}

TEST(Report, ModeChangesHaveTheirNamesAndADamagedOneIsUnknown) {
  TraceRecord changed = record(TraceKind::mode, 2 * ns_per_s, 1, static_cast<std::uint64_t>(LinkPhase::flying), 0,
                               static_cast<double>(FailsafeCause::fence));
  changed.extra = static_cast<std::uint32_t>(FailsafeMode::brake);
  const TraceRecord damaged = record(TraceKind::mode, 3 * ns_per_s, 1, 77, 0, -1);
  const auto changes = mode_changes({changed, damaged}, 1, ns_per_s, 9 * ns_per_s);
  ASSERT_EQ(changes.size(), 2u);
  EXPECT_EQ(changes[0].phase + " " + changes[0].mode + " " + changes[0].cause, "flying brake fence");
  EXPECT_DOUBLE_EQ(changes[0].t_s, 1);
  EXPECT_EQ(changes[1].phase + changes[1].cause, "unknownunknown");
}

TEST(Report, QuantilesAreThoseOfTheSamples) {
  std::vector<Sample> samples;
  for (int i = 1; i <= 1000; ++i) samples.push_back({0, i * 0.1});
  const Quantiles q = quantiles_of(samples);
  EXPECT_EQ(q.count, 1000u);
  EXPECT_NEAR(q.p5, 5, 0.1);
  EXPECT_NEAR(q.q1, 25, 0.5);
  EXPECT_NEAR(q.median, 50, 1);
  EXPECT_NEAR(q.q3, 75, 1.5);
  EXPECT_NEAR(q.p99, 99, 2);
  EXPECT_NEAR(q.max, 100, 1e-6);
}

TEST(Report, CrossTrackIsMeasuredBetweenTheEndsOfThePathAlone) {
  const ground::Path path(ground::Shape::square, {0, 0}, 1.5);
  const std::vector<TraceRecord> truth{
      record(TraceKind::truth, 1, 1, 0, 0, 9, 9),       record(TraceKind::truth, 10, 1, 0, 0, 0.5, 0.3),
      record(TraceKind::truth, 11, 1, 0, 0, 0.5, -0.4), record(TraceKind::truth, 12, 2, 0, 0, 5, 5),
      record(TraceKind::truth, 99, 1, 0, 0, 9, 9),
  };
  const CrossTrack error = cross_track(truth, 1, path, 5, 50);
  EXPECT_EQ(error.count, 2u);
  EXPECT_NEAR(error.rms_m, std::sqrt((0.09 + 0.16) / 2), 1e-9);
  EXPECT_NEAR(error.max_m, 0.4, 1e-9);
}

class RunDirectory : public testing::Test {
 protected:
  RunDirectory() {
    char name[] = "/tmp/ledgerline-report-XXXXXX";
    files.directory = mkdtemp(name);
  }
  ~RunDirectory() override { std::filesystem::remove_all(files.directory); }

  void write(const std::string& path, const std::string& text) const { std::ofstream(path) << text; }
  void write_trace(const std::string& program, const std::vector<TraceRecord>& records) const {
    auto writer = TraceWriter::create(files.trace(program));
    ASSERT_TRUE(writer);
    for (const auto& r : records) writer->add(r);
  }

  /// What the programs of a flight of one drone leave.
  void fill() {
    write(files.summary("node"),
          R"({"blocks":12,"transactions":11,"invalid":0,"storage":"tmpfs","restarts":{"peer1":2,"peer2":0},)"
          R"("disk_ms":{"p5":1,"q1":2,"median":3,"q3":4,"p95":5,"p99":6,"max":7,"count":12}})");
    write(
        files.summary("link"),
        R"({"drones":[{"name":"tello1","states_lost":1,"transitions":{"made":6,"on_ledger":5,"lost":1,"kept":0},"commands_applied":7,"commands_late":1,"commands_dropped":2,"drop_reasons":{"not_flying":2}}]})");
    write(
        files.summary("agent"),
        R"({"drones":[{"name":"tello1","states":{"sampled":20,"sent":18,"on_ledger":17,"merged":2,"dropped":1},"transitions":{"on_ledger":5},)"
        R"("commands":{"on_ledger":10,"refused":3,"refused_reasons":{"too_old":3}}}],"transactions":{"committed":17}})");
    write(
        files.summary("ground"),
        R"({"drones":[{"name":"tello1","finished":true,"landed":true,"lap_s":[12.5,13.5],"lap_m":6.25,"origin":[1.0,2.0],"height_m":1.0,)"
        R"("commands_sent":11,"commands_refused":1,"path_ns":[1000000000,9000000000]}],"transactions":{"committed":10},"why":""})");
    write_trace("agent", {record(TraceKind::command_verified, 2'010'000'000, 1, 1, 2'000'000'000)});
    write_trace("link", {record(TraceKind::command_applied, 2'020'000'000, 1, 1, 2'000'000'000)});
    write_trace("sim", {record(TraceKind::truth, 2'000'000'000, 1, 0, 0, 1.5, 2.1)});
    run.ok = true;
    run.begin_ns = ns_per_s;
    run.end_ns = 11 * ns_per_s;
    run.cpu_percent = {{"link", 12.34}, {"node", 5}};
    run.memory_mb = {{"link", 45.67}};
    run.ledger_grown_bytes = 5'000'000;
  }

  launcher::RunFiles files;
  launcher::Options options;
  launcher::RunRecord run;
};

TEST_F(RunDirectory, FiguresThatCannotBeAreLeftOut) {
  fill();
  write(files.summary("node"), R"({"blocks":-1,"transactions":1e300,"storage":7,"disk_ms":{"p5":"x","max":7}})");
  write(files.summary("ground"), R"({"drones":[{"name":"tello1","origin":[1,2],"path_ns":[-1e300,1e300],"lap_s":3}]})");
  constexpr TimeNs lowest = std::numeric_limits<TimeNs>::min();
  write_trace("agent", {record(TraceKind::command_verified, 2'010'000'000, 1, 1, lowest),
                        record(TraceKind::command_verified, lowest, 1, 2, 2'000'000'000),
                        record(TraceKind::command_verified, 2'010'000'000, 1, 3, 2'000'000'000)});
  const Results r = read_results(files, options, run);
  EXPECT_EQ(r.blocks, 0u);
  EXPECT_EQ(r.transactions, 0u);
  EXPECT_EQ(r.disk_ms.max, 7);
  EXPECT_EQ(r.disk_ms.p5, 0);
  EXPECT_EQ(r.drones.at(0).two_way.size(), 1u);
}

TEST_F(RunDirectory, OfAFlightByHandThePathIsOfEveryTakeOff) {
  fill();
  options.manual = true;
  write_trace("sim", {record(TraceKind::truth, 100'000'000, 1, 0, 0, 0.5, 0.5),  // before the last take-off
                      record(TraceKind::truth, 2'000'000'000, 1, 0, 0, 1.5, 2.1)});
  EXPECT_EQ(read_results(files, options, run).drones.at(0).flown.size(), 2U);
}

TEST_F(RunDirectory, TheJsonObjectHasEveryFieldThatIsPromised) {
  fill();
  const json r = to_json(read_results(files, options, run));
  for (const char* key : {"asked", "machine", "ledger", "drones", "messages_per_s", "transactions_per_s", "cpu_percent",
                          "memory_mb", "ok"}) {
    EXPECT_TRUE(r.contains(key)) << key;
  }
  EXPECT_EQ(r["ok"], true);
  EXPECT_FALSE(r.contains("why"));
  EXPECT_EQ(r["ledger"]["kind"], "embedded");
  EXPECT_EQ(r["ledger"]["storage"], "tmpfs");
  EXPECT_EQ(r["ledger"]["disk_ms"]["max"], 7);
  EXPECT_EQ(r["ledger"]["blocks"], 12);
  EXPECT_EQ(r["ledger"]["bytes_per_drone_hour"], 1.8e9) << "5 MB in 10 s by one drone";
  EXPECT_EQ(r["ledger"]["restarts"], (json{{"peer1", 2}}));
  EXPECT_EQ(r["ledger"]["transactions"], 11);
  EXPECT_EQ(r["cpu_percent"]["link"], 12.3);
  EXPECT_EQ(r["memory_mb"]["link"], 45.7);
  EXPECT_NEAR(r["messages_per_s"].get<double>(), 2.7, 1e-9);
  EXPECT_NEAR(r["transactions_per_s"].get<double>(), 2.7, 1e-9);
  ASSERT_EQ(r["drones"].size(), 1u);
  const json& drone = r["drones"][0];
  EXPECT_EQ(drone["id"], "tello1");
  for (const char* latency : {"two_way_ms", "age_ms"}) {
    for (const char* key : {"p5", "q1", "median", "q3", "p95", "p99", "max", "count"}) {
      EXPECT_TRUE(drone[latency].contains(key)) << latency << " " << key;
    }
  }
  EXPECT_NEAR(drone["two_way_ms"]["max"].get<double>(), 10, 1e-6);
  EXPECT_NEAR(drone["age_ms"]["max"].get<double>(), 20, 1e-6);
  EXPECT_NEAR(drone["cross_track_m"]["rms"].get<double>(), 0.1, 1e-6);
  EXPECT_EQ(drone["lap_s"], json({12.5, 13.5}));
  EXPECT_EQ(drone["turns"][0]["flown_mps"], 0.5);  // by the length that was flown, corners and all
  EXPECT_EQ(drone["transitions"], json({{"made", 6}, {"on_ledger", 5}, {"lost", 1}}));
  EXPECT_EQ(drone["states"], json({{"sampled", 21}, {"sent", 18}, {"on_ledger", 17}, {"merged", 2}, {"dropped", 2}}));
  EXPECT_EQ(drone["commands"], json({{"sent", 11},
                                     {"on_ledger", 10},
                                     {"refused", 4},
                                     {"applied", 7},
                                     {"late", 1},
                                     {"dropped", 2},
                                     {"reasons", {{"not_flying", 2}, {"too_old", 3}}}}));
}

TEST_F(RunDirectory, TheFaultsOfTheProxyAndTheShimAreInTheResults) {
  fill();
  EXPECT_FALSE(to_json(read_results(files, options, run))["asked"].contains("faults"));
  options.proxy = true;
  options.faults = "stall.toml";
  write(files.summary("hil-proxy"), R"({"switched":[{"t_ns":2500000000,"command":"server * both stall"},{"t_ns":7}]})");
  const Results results = read_results(files, options, run);
  EXPECT_EQ(to_json(results)["asked"]["faults"],
            (json{{"file", "stall.toml"}, {"switched", {{{"t_s", 1.5}, {"command", "server * both stall"}}}}}));
  EXPECT_THAT(to_table(results), HasSubstr("  Faults:\n    of stall.toml\n    1.5 s: server * both stall\n"));
  options.shim = true;
  write(files.summary("sim"), R"({"switched":[{"t_ns":2000000000,"command":"sdk tello1 answers missing"}]})");
  EXPECT_THAT(to_table(read_results(files, options, run)),
              HasSubstr("    1.0 s: sdk tello1 answers missing\n    1.5 s: server * both stall\n"));
  options.shim = false;
  options.faults = "";
  write(files.summary("hil-proxy"), R"({"switched":[]})");
  EXPECT_THAT(to_table(read_results(files, options, run)), testing::Not(HasSubstr("Faults")));
}

TEST_F(RunDirectory, TheTableSaysWhenTheFailsafeActedAndWhoStoppedTheDrone) {
  fill();
  EXPECT_THAT(to_table(read_results(files, options, run)), testing::Not(HasSubstr("Failsafe and stops")));
  std::vector<TraceRecord> modes;
  for (const FailsafeMode mode : {FailsafeMode::none, FailsafeMode::land, FailsafeMode::land}) {
    const auto count = static_cast<TimeNs>(modes.size());
    modes.push_back(record(TraceKind::mode, (3'400 + 100 * count) * ns_per_ms, 1,
                           static_cast<std::uint64_t>(LinkPhase::flying), 0,
                           static_cast<double>(FailsafeCause::stopped)));
    modes.back().extra = static_cast<std::uint32_t>(mode);
  }
  write_trace("link", modes);
  write(files.summary("ground"), R"({"drones":[{"name":"tello1","why":"stopped by Org2MSP CN=alice"}]})");
  EXPECT_THAT(to_table(read_results(files, options, run)),
              HasSubstr("  Failsafe and stops:\n  tello1    2.5 s: land (stopped)\n"
                        "  tello1    stopped by Org2MSP CN=alice\n"));
}

TEST_F(RunDirectory, ARunThatWentWrongSaysWhyAndNamesWhatIsMissing) {
  run.why = "agent was ended by signal 9 (Killed) during the flight";
  const Results results = read_results(files, options, run);
  const json r = to_json(results);
  EXPECT_EQ(r["ok"], false);
  EXPECT_THAT(r["why"].get<std::string>(), HasSubstr("agent"));
  EXPECT_TRUE(r["drones"][0]["cross_track_m"].is_null());
  EXPECT_EQ(results.missing.size(), 7u);
  EXPECT_THAT(to_table(results), HasSubstr("missing or unreadable: " + files.trace("agent")));
}

TEST_F(RunDirectory, TheTableShowsOursBesideThePublishedFiguresAndWhatDiffers) {
  fill();
  Results results = read_results(files, options, run);
  results.drones.at(0).states = {.sampled = 99'999, .sent = 0, .on_ledger = 12'345, .merged = 1'234, .dropped = 12'345};
  const std::string table = to_table(results);
  EXPECT_THAT(table, HasSubstr("12345 on the ledger, 1234 merged, 12345 dropped  ")) << "columns stay apart";
  EXPECT_THAT(table, HasSubstr("the published study: Wi-Fi between three machines"));
  for (const char* part : {"tello1 two-way", "tello1 age at application", "published two-way, square", "456",
                           "What differs", "0.100", "2 x 13.0", "tmpfs", "link 12.3 %"}) {
    EXPECT_THAT(table, HasSubstr(part));
  }
}

TEST_F(RunDirectory, ThePageIsWholeInItselfAndNoTextCanEndItsScript) {
  fill();
  run.ok = false;
  run.why = "</script><b>broken</b>";
  const std::string chart = files.in("chart.js");
  write(chart, "/* the chart library */");
  const auto page = to_page(read_results(files, options, run), chart);
  ASSERT_TRUE(page) << page.error().message;
  EXPECT_THAT(*page, HasSubstr("/* the chart library */"));
  EXPECT_THAT(*page, testing::Not(HasSubstr("<b>broken")));
  EXPECT_THAT(*page, HasSubstr("\\u003c/script>"));
  for (const char* outside : {"src=\"", "href=\"", "@DATA@", "@CHART_JS@"})
    EXPECT_THAT(*page, testing::Not(HasSubstr(outside)));
}

TEST_F(RunDirectory, ThePageHasWhatWasReportedOfThePositionBesideTheError) {
  fill();
  const auto truth = [](TimeNs t_ns, double x, std::uint32_t in_flight) {
    TraceRecord r = record(TraceKind::truth, t_ns, 1, 0, 0, x, 2);
    r.extra = in_flight;
    return r;
  };
  // It flies along x at 1 m/s from second 2 to 3.
  std::vector<TraceRecord> real{truth(1'900 * ns_per_ms, 1, 0)};
  for (int i = 0; i <= 10; ++i) real.push_back(truth((2'000 + 100 * i) * ns_per_ms, 1 + 0.1 * i, 1));
  write_trace("sim", real);
  std::vector<TraceRecord> link;
  const auto tell = [&](TimeNs t_ms, TimeNs pose_ms, double x, double y, double variance_x_m2, double variance_y_m2) {
    link.push_back(record(TraceKind::state_sampled, t_ms * ns_per_ms, 1, 1, t_ms * ns_per_ms, x, y));
    link.push_back(
        record(TraceKind::pose_reported, t_ms * ns_per_ms, 1, 1, pose_ms * ns_per_ms, variance_x_m2, variance_y_m2));
  };
  tell(1'800, 1'800, 1, 2, 0.01, 0.01);         // on the ground
  tell(2'260, 2'250, 1.25, 2.2, 0.01, 0.0025);  // 0.2 m beside it, where 0.3 is reported
  tell(2'760, 2'750, 1.75, 1.5, 0.0025, 0.01);  // 0.5 m
  write_trace("link", link);
  const Results results = read_results(files, options, run);
  ASSERT_EQ(results.drones.at(0).reported.size(), 2u);
  EXPECT_NEAR(results.drones[0].reported[0].t_s, 1.26, 1e-9);
  EXPECT_NEAR(results.drones[0].reported[0].three_sigma_m, 0.3, 1e-9);
  EXPECT_NEAR(*results.drones[0].reported[0].error_m, 0.2, 1e-9);
  EXPECT_NEAR(*results.drones[0].reported[1].error_m, 0.5, 1e-9);
  const json metrics = to_json(results)["drones"][0]["reported_position"];
  EXPECT_EQ(metrics["count"], 2);
  EXPECT_NEAR(metrics["max_three_sigma_m"].get<double>(), 0.3, 1e-9);
  EXPECT_NEAR(metrics["rms_error_m"].get<double>(), std::sqrt((0.04 + 0.25) / 2), 1e-3);
  EXPECT_NEAR(metrics["max_error_m"].get<double>(), 0.5, 1e-9);
  EXPECT_EQ(metrics["inside"], 0.5);
  const std::string chart = files.in("chart.js");
  write(chart, "/* the chart library */");
  const auto page = to_page(results, chart);
  ASSERT_TRUE(page) << page.error().message;
  EXPECT_THAT(*page, HasSubstr(R"("reported":[[1.26,0.3,0.2],[1.76,0.3,0.5]])"));
}

TEST_F(RunDirectory, WhereNobodyTellsAVarianceThereIsNothingToShow) {
  fill();
  const Results results = read_results(files, options, run);
  EXPECT_TRUE(results.drones.at(0).reported.empty());
  EXPECT_TRUE(to_json(results)["drones"][0]["reported_position"].is_null());
}

TEST(Report, WithoutATruthWhatWasReportedStandsAlone) {
  std::vector<TraceRecord> link;
  for (const double variance_m2 : {0.04, 0.0, std::numeric_limits<double>::infinity(), 0.01}) {
    const TimeNs t_ns = static_cast<TimeNs>(link.size() + 1) * ns_per_s;
    link.push_back(record(TraceKind::state_sampled, t_ns, 1, 1, t_ns));
    link.push_back(record(TraceKind::pose_reported, t_ns, 1, 1, t_ns, variance_m2, 0));
  }
  EXPECT_TRUE(reported_positions(link, {}, 2, 0).empty());
  const auto reported = reported_positions(link, {}, 1, 0);
  ASSERT_EQ(reported.size(), 2u);  // no variance, and one that is no number, are not reported
  EXPECT_FALSE(reported[0].error_m.has_value());
  const auto metrics = metrics_of(reported);
  ASSERT_TRUE(metrics.has_value());
  EXPECT_NEAR(metrics->max_three_sigma_m, 0.6, 1e-9);
  EXPECT_FALSE(metrics->inside.has_value());
  EXPECT_EQ(reported_positions(link, {}, 1, 3 * ns_per_s).size(), 1u);
}

TEST_F(RunDirectory, WithoutTheChartLibraryThePageNamesThePackage) {
  fill();
  const auto page = to_page(read_results(files, options, run), files.in("nothing.js"));
  ASSERT_FALSE(page);
  EXPECT_THAT(page.error().message, HasSubstr("apt-get install libjs-chart.js"));
}

TEST(Published, SeveralDronesStandBesideThePublishedThree) {
  EXPECT_EQ(published_for("x", 1).name, "x");
  EXPECT_EQ(published_for("square", 3).name, "3 drones");
}

}  // namespace
}  // namespace ledgerline::report
