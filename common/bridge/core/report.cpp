#include "common/bridge/core/report.hpp"

#include <nlohmann/json.hpp>

#include "common/rt/histogram.hpp"

namespace ledgerline::bridge {
namespace {

using nlohmann::json;

template <typename Why, std::size_t count>
json reasons(const std::array<std::uint64_t, count>& counts) {
  json out = json::object();
  for (std::size_t i = 0; i < count; ++i) {
    if (counts[i] > 0) out[std::string(name(static_cast<Why>(i)))] = counts[i];
  }
  return out;
}

}  // namespace

json report(const Uplink& uplink) {
  json topics = json::array();
  for (const Uplink::Topic& topic : uplink.topics()) {
    const UplinkCounters& c = topic.counters;
    topics.push_back({{"topic", topic.name},
                      {"type", topic.type},
                      {"id", topic.id},
                      {"direction", "to_ledger"},
                      {"taken", c.taken},
                      {"messages", c.on_ledger},
                      {"bytes", c.bytes},
                      {"batches", c.batches},
                      {"pending", c.pending},
                      {"dds_lost", c.dds_lost},
                      {"dds_refused", c.dds_refused},
                      {"age_ms", c.age.quantiles_ms()},
                      {"drops", reasons<Drop>(c.drops)}});
  }
  return topics;
}

json report(const Downlink& downlink) {
  json topics = json::array();
  for (const Downlink::Topic& topic : downlink.topics()) {
    const DownlinkCounters& c = topic.counters;
    topics.push_back({{"topic", topic.name},
                      {"type", topic.type},
                      {"id", topic.id},
                      {"direction", "from_ledger"},
                      {"taken", c.taken},
                      {"messages", c.published},
                      {"bytes", c.bytes},
                      {"batches", c.batches},
                      {"missing", c.missing},
                      {"age_ms", c.age.quantiles_ms()},
                      {"drops", reasons<Refusal>(c.refusals)}});
  }
  return topics;
}

}  // namespace ledgerline::bridge
