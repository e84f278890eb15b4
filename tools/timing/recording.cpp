#include "tools/timing/metrics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "common/base/file.hpp"

namespace ledgerline::timing {

Recording::Recording(std::string directory) : directory_(std::move(directory)) {
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

Status Recording::read_new() {
  for (File& file : files_) {
    const std::string path = directory_ + "/" + file.name;
    if (!file.reader) {
      if (file.writer != Writer::link && !std::filesystem::exists(path)) continue;
      auto reader = TraceReader::open(path);
      if (!reader) return reader.error();
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

std::vector<std::string> Recording::missing() const {
  std::vector<std::string> names;
  for (const File& file : files_) {
    if (!file.reader) names.push_back(directory_ + "/" + file.name);
  }
  return names;
}

void Recording::forget_turns_before(TimeNs t_ns) {
  std::erase_if(loop_turns_, [&](const TraceRecord& r) { return r.t_ns < t_ns; });
}

Result<UsageRecord> Recording::usage() const {
  const std::string path = directory_ + "/" + usage_file;
  const auto text = read_file(path);
  if (!text) return text.error();
  auto record = usage_from_json(*text);
  if (!record) return Error{path + ": " + record.error().message};
  return record;
}

}  // namespace ledgerline::timing
