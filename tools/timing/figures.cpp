#include "tools/timing/figures.hpp"

#include <algorithm>
#include <optional>

#include "common/rt/loop_ticker.hpp"

namespace ledgerline::timing {
namespace {

constexpr std::uint16_t overrun_us = 1000;

Histogram between(std::span<const Walk> walks, const Stage& stage) {
  Histogram histogram;
  for (const Walk& walk : walks) {
    if (walk.has(stage.from) && walk.has(stage.to)) histogram.add(walk.at(stage.to) - walk.at(stage.from));
  }
  return histogram;
}

Histogram setpoints_at_once(std::span<const Walk> walks) {
  std::vector<Walk> due;
  std::copy_if(walks.begin(), walks.end(), std::back_inserter(due), [](const Walk& w) { return w.due_at_once(); });
  return between(due, totals.back());
}

LoopFigures loop_figures(std::span<const TraceRecord> records) {
  LoopFigures figures;
  std::optional<std::uint64_t> next;
  for (const TraceRecord& record : records) {
    const auto late_us = PackedTurns::late_us(record);
    if (next && record.id > *next) figures.lost += record.id - *next;
    if (next && record.id < *next) continue;  // twice there, or of a link before
    next = record.id + late_us.size();
    for (const std::uint16_t us : late_us) {
      figures.late.add(us * ns_per_us);
      if (us > overrun_us) ++figures.overruns;
    }
  }
  return figures;
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

const Histogram* Figures::find(std::string_view name) const {
  const auto found =
      std::find_if(distributions.begin(), distributions.end(), [&](const Distribution& d) { return d.name == name; });
  return found == distributions.end() ? nullptr : &found->histogram;
}

Figures make_figures(std::span<const Walk> walks, std::span<const TraceRecord> loop_turns) {
  Figures figures;
  figures.walks = walks.size();
  for (const Walk& walk : walks) ++figures.got_to[static_cast<std::size_t>(walk.last())];
  if (!walks.empty()) figures.seconds = to_seconds(walks.back().at(Mark::sampled) - walks.front().at(Mark::sampled));
  for (const Stage& stage : stages) figures.distributions.push_back({stage.name, stage.what, between(walks, stage)});
  for (const Stage& stage : totals) figures.distributions.push_back({stage.name, stage.what, between(walks, stage)});
  figures.distributions.push_back({at_once, "the same, of those not held back on purpose", setpoints_at_once(walks)});
  figures.loop = loop_figures(loop_turns);
  figures.distributions.push_back({late, "how late link's turns began", figures.loop.late});
  return figures;
}

Tail tail_of(const Histogram& h) {
  return {to_ms(h.quantile(0.5)),   to_ms(h.quantile(0.95)), to_ms(h.quantile(0.99)),
          to_ms(h.quantile(0.999)), to_ms(h.max()),          h.count()};
}

}  // namespace ledgerline::timing
