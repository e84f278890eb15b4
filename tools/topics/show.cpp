#include "tools/topics/show.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/text.hpp"

namespace ledgerline::topics {
namespace {

using nlohmann::json;

constexpr std::size_t max_name = 128;

std::string text_of(const json& value) { return printable(value.get<std::string>(), max_name); }

Row row_of(const std::string& channel, const json& topic) {
  Row row{.channel = channel,
          .topic = text_of(topic.at("topic")),
          .id = text_of(topic.at("id")),
          .direction = text_of(topic.at("direction")),
          .messages = topic.at("messages").get<double>(),
          .bytes = topic.at("bytes").get<double>(),
          .batches = topic.at("batches").get<double>(),
          .median_ms = topic.at("age_ms").at("median").get<double>(),
          .p99_ms = topic.at("age_ms").at("p99").get<double>(),
          .drops = {}};
  const auto count = [&row](const std::string& what, double number) {
    if (number > 0) row.drops += fmt::format("{}{} {:.0f}", row.drops.empty() ? "" : ", ", printable(what), number);
  };
  for (const auto& [why, number] : topic.at("drops").items()) count(why, number.get<double>());
  for (const char* what : {"missing", "dds_lost", "dds_refused"}) count(what, topic.value(what, 0.0));
  if (topic.contains("unheard")) row.drops += (row.drops.empty() ? "" : ", ") + std::string("a writer is not heard");
  return row;
}

std::string per_second(const Row& now, const Row* before, double Row::*what, double seconds) {
  if (!before || !(seconds > 0)) return "-";
  return fmt::format("{:.1f}", (now.*what - before->*what) / seconds);
}

}  // namespace

Result<Status> parse_status(std::string_view text, const std::string& file, TimeNs now) {
  Status status;
  double period_s = 0;
  try {
    const json read = json::parse(text);
    status.time_s = 1e-9 * read.at("time_ns").get<double>();
    period_s = 1e-3 * read.at("period_ms").get<double>();
    for (const json& channel : read.at("channels")) {
      const std::string name = text_of(channel.at("channel"));
      for (const json& topic : channel.at("topics")) status.rows.push_back(row_of(name, topic));
      if (!channel.at("connected").get<bool>()) status.unreached.push_back(name);
    }
  } catch (const json::exception&) {
    return Error{file + ": no status of a bridge ([output] status in its config names the file)"};
  }
  const double age_s = to_seconds(now) - status.time_s;
  if (age_s > 3 * period_s + 1)
    return Error{fmt::format("{}: its bridge has said nothing for {:.0f} s; is it running?", file, age_s)};
  return status;
}

std::string table(const Status& before, const Status& now) {
  std::string text = fmt::format("{:<32} {:<4} {:>9} {:>11} {:>10} {:>8} {:>8} {:>8}  {}\n", "topic", "way", "msg/s",
                                 "bytes/s", "messages", "batches", "p50 ms", "p99 ms", "drops");
  for (const Row& row : now.rows) {
    const auto same = std::find_if(before.rows.begin(), before.rows.end(), [&](const Row& r) {
      return r.channel == row.channel && r.id == row.id && r.direction == row.direction;
    });
    const Row* earlier = same == before.rows.end() ? nullptr : &*same;
    const double seconds = now.time_s - before.time_s;
    text += fmt::format("{:<32} {:<4} {:>9} {:>11} {:>10.0f} {:>8.0f} {:>8.1f} {:>8.1f}  {}\n", row.topic,
                        row.direction == "to_ledger" ? "up" : "down", per_second(row, earlier, &Row::messages, seconds),
                        per_second(row, earlier, &Row::bytes, seconds), row.messages, row.batches, row.median_ms,
                        row.p99_ms, row.drops.empty() ? "-" : row.drops);
  }
  for (const std::string& channel : now.unreached)
    text += fmt::format("channel {}: the ledger is not reached\n", channel);
  return text;
}

}  // namespace ledgerline::topics
