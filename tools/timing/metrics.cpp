#include "tools/timing/metrics.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <filesystem>
#include <map>
#include <optional>
#include <sstream>

#include "common/base/file.hpp"
#include "common/rt/loop_ticker.hpp"

namespace ledgerline::timing {
namespace {

constexpr std::uint16_t overrun_us = 1000;

Histogram between(std::span<const SampleTrace> traces, const Stage& stage) {
  Histogram histogram;
  for (const SampleTrace& trace : traces) {
    if (trace.has(stage.from) && trace.has(stage.to)) histogram.add(trace.at(stage.to) - trace.at(stage.from));
  }
  return histogram;
}

Histogram setpoints_at_once(std::span<const SampleTrace> traces) {
  std::vector<SampleTrace> due;
  std::copy_if(traces.begin(), traces.end(), std::back_inserter(due),
               [](const SampleTrace& w) { return w.due_at_once(); });
  return between(due, *std::ranges::find(totals, "setpoint", &Stage::name));
}

LoopMetrics loop_metrics(std::span<const TraceRecord> records) {
  LoopMetrics metrics;
  std::optional<std::uint64_t> next;
  for (const TraceRecord& record : records) {
    const auto late_us = PackedTurns::late_us(record);
    if (next && record.id > *next) metrics.lost += record.id - *next;
    if (next && record.id < *next) continue;  // twice there, or of a link before
    next = record.id + late_us.size();
    for (const std::uint16_t us : late_us) {
      metrics.late.add(us * ns_per_us);
      if (us > overrun_us) ++metrics.overruns;
    }
  }
  return metrics;
}

constexpr std::array<std::pair<std::string_view, double>, 4> quantiles{
    {{"p50", 0.5}, {"p95", 0.95}, {"p99", 0.99}, {"p99.9", 0.999}}};

/// The number, in the unit's own size; none when it is not a number of 0 or more with one of these units.
std::optional<double> amount(const std::string& text, const std::map<std::string, double>& units) {
  double number = 0;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  const auto unit = units.find(std::string(rest, text.data() + text.size()));
  if (error != std::errc() || unit == units.end() || !(number >= 0)) return std::nullopt;
  return number * unit->second;
}

bool is_quantile(const std::string& name) {
  return name == "max" ||
         std::any_of(quantiles.begin(), quantiles.end(), [&](const auto& q) { return q.first == name; });
}

std::vector<std::string> split(const std::string& text, char by) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, by);) parts.push_back(part);
  return parts;
}

}  // namespace

std::vector<std::string_view> distribution_names() {
  std::vector<std::string_view> names;
  for (const Stage& stage : stages) names.push_back(stage.name);
  for (const Stage& stage : totals) names.push_back(stage.name);
  names.push_back(at_once);
  names.push_back(late);
  return names;
}

const Histogram* Metrics::find(std::string_view name) const {
  const auto found =
      std::find_if(distributions.begin(), distributions.end(), [&](const Distribution& d) { return d.name == name; });
  return found == distributions.end() ? nullptr : &found->histogram;
}

Metrics make_metrics(std::span<const SampleTrace> traces, std::span<const TraceRecord> loop_turns) {
  Metrics metrics;
  metrics.traces = traces.size();
  for (const SampleTrace& trace : traces) ++metrics.got_to[static_cast<std::size_t>(trace.last())];
  if (!traces.empty()) metrics.seconds = to_seconds(traces.back().at(Mark::sampled) - traces.front().at(Mark::sampled));
  for (const Stage& stage : stages) metrics.distributions.push_back({stage.name, stage.what, between(traces, stage)});
  for (const Stage& stage : totals) metrics.distributions.push_back({stage.name, stage.what, between(traces, stage)});
  metrics.distributions.push_back(
      {at_once, "`setpoint`, of those not held back on purpose", setpoints_at_once(traces)});
  metrics.loop = loop_metrics(loop_turns);
  metrics.distributions.push_back({late, "how late link's turns began", metrics.loop.late});
  return metrics;
}

Tail tail_of(const Histogram& h) {
  return {to_ms(h.quantile(0.5)),   to_ms(h.quantile(0.95)), to_ms(h.quantile(0.99)),
          to_ms(h.quantile(0.999)), to_ms(h.max()),          h.count()};
}

Result<Limit> parse_limit(const std::string& text) {
  const auto equals = text.find('=');
  if (equals == std::string::npos) return Error{fmt::format("\"{}\" is no limit: write p99.apply=1ms", text)};
  const std::string left = text.substr(0, equals), right = text.substr(equals + 1);
  Limit limit;
  limit.text = text;
  std::optional<double> bound;
  std::string unit;
  if (left == "overruns") {
    limit.quantity = left;
    bound = amount(right, {{"", 1}});
    unit = "a count, such as 0";
  } else if (left == "headroom" || left.starts_with("cpu.")) {
    limit.quantity = left.substr(0, left.find('.'));
    if (limit.quantity == "cpu") limit.programs = split(left.substr(4), '+');
    if (limit.quantity == "cpu" && limit.programs.empty()) return Error{fmt::format("\"{}\" names no program", text)};
    bound = amount(right, {{"%", 1}});
    unit = "percent of one core, such as 15%";
  } else {
    const auto dot = left.rfind('.');  // p99.9 has one of its own
    limit.quantity = left.substr(0, dot);
    limit.stage = dot == std::string::npos ? "" : left.substr(dot + 1);
    if (!is_quantile(limit.quantity)) {
      return Error{
          fmt::format("\"{}\": there is no quantity \"{}\"; there are p50, p95, p99, p99.9 and max of a stage, "
                      "cpu.PROGRAM, overruns "
                      "and headroom",
                      text, limit.quantity)};
    }
    const auto names = distribution_names();
    if (std::find(names.begin(), names.end(), limit.stage) == names.end())
      return Error{
          fmt::format("\"{}\": there is no stage \"{}\"; there are {}", text, limit.stage, fmt::join(names, ", "))};
    bound = amount(right, {{"us", 1e-3}, {"ms", 1}, {"s", 1e3}});
    unit = "a time, such as 200us, 1ms or 2s";
  }
  if (!bound) return Error{fmt::format("\"{}\": \"{}\" is not {}", text, right, unit)};
  limit.bound = *bound;
  return limit;
}

Verdict check(const Limit& limit, const Metrics& metrics) {
  Verdict verdict{limit.text, std::nullopt, false,
                  limit.quantity == "overruns" ? ""
                  : limit.stage.empty()        ? "%"
                                               : "ms"};
  if (limit.quantity == "overruns") {
    if (metrics.loop.late.count() > 0) verdict.measured = static_cast<double>(metrics.loop.overruns);
  } else if (limit.quantity == "headroom") {
    if (metrics.load.seconds > 0) verdict.measured = metrics.load.headroom_percent();
    verdict.kept = verdict.measured && *verdict.measured >= limit.bound;
    return verdict;
  } else if (limit.quantity == "cpu") {
    double sum = 0;
    for (const std::string& program : limit.programs) {
      const auto found = metrics.load.programs.find(program);
      if (found == metrics.load.programs.end()) return verdict;
      sum += found->second;
    }
    verdict.measured = sum;
  } else if (const Histogram* histogram = metrics.find(limit.stage); histogram && histogram->count() > 0) {
    const auto q =
        std::find_if(quantiles.begin(), quantiles.end(), [&](const auto& one) { return one.first == limit.quantity; });
    verdict.measured = to_ms(q == quantiles.end() ? histogram->max() : histogram->quantile(q->second));
    const auto count = static_cast<double>(histogram->count());
    if (q != quantiles.end() && count * (1 - q->second) < 1 - 1e-9)
      verdict.note = fmt::format("{} of {:.0f} samples is their maximum", limit.quantity, count);
  }
  verdict.kept = verdict.measured && *verdict.measured <= limit.bound;
  return verdict;
}

TraceFolder::TraceFolder(std::string directory) : directory_(std::move(directory)) {
  const auto has_trace = [](const std::string& folder) { return std::filesystem::exists(folder + "/link.trace"); };
  if (!has_trace(directory_) && has_trace(directory_ + "/run")) directory_ += "/run";
  for (const auto& [writer, name] :
       {std::pair{Writer::link, "link"}, {Writer::agent, "agent"}, {Writer::ground, "ground"}}) {
    // The last life's trace has no number.
    std::uint32_t life = 0;
    for (std::string file;
         file = fmt::format("{}.{}.trace", name, life + 1), std::filesystem::exists(directory_ + "/" + file); ++life)
      files_.push_back({writer, life, file});
    files_.push_back({writer, life, fmt::format("{}.trace", name)});
  }
}

Status TraceFolder::read_new() {
  for (File& file : files_) {
    const std::string path = directory_ + "/" + file.name;
    if (!file.reader) {
      if (file.writer != Writer::link && !std::filesystem::exists(path)) continue;
      auto reader = TraceReader::open(path);
      if (!reader)
        return Error{fmt::format(
            "{}: DIR is the --out of a `ledgerline fly`, or SCRIPT-SEED in the --out of a `fault run --real`",
            reader.error().message)};
      file.reader.emplace(std::move(*reader));
    }
    const auto records = file.reader->read_new();
    if (!records) return records.error();
    traces_.add(file.writer, *records, file.life);
    if (file.writer != Writer::link) continue;
    std::copy_if(records->begin(), records->end(), std::back_inserter(loop_turns_),
                 [](const TraceRecord& r) { return r.kind == TraceKind::loop_turns; });
  }
  return done;
}

std::vector<std::string> TraceFolder::missing() const {
  std::vector<std::string> names;
  for (const File& file : files_) {
    if (!file.reader) names.push_back(directory_ + "/" + file.name);
  }
  return names;
}

void TraceFolder::forget_turns_before(TimeNs t_ns) {
  std::erase_if(loop_turns_, [&](const TraceRecord& r) { return r.t_ns < t_ns; });
}

Result<UsageRecord> TraceFolder::usage() const {
  const std::string path = directory_ + "/" + usage_file;
  const auto text = read_file(path);
  if (!text) return text.error();
  auto record = usage_from_json(*text);
  if (!record) return Error{path + ": " + record.error().message};
  return record;
}

}  // namespace ledgerline::timing
