#include "ground/timing/recording.hpp"

#include <algorithm>
#include <filesystem>

#include "common/rt/file.hpp"

namespace ledgerline::timing {

std::vector<Recording::File> Recording::make_files() {
  std::vector<File> files;
  files.push_back({Writer::link, "link.trace"});
  files.push_back({Writer::agent, "agent.trace"});
  files.push_back({Writer::ground, "ground.trace"});
  return files;
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
    walks_.add(file.writer, *records);
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
  if (!record) return Error{path + ": " + record.error().what};
  return record;
}

}  // namespace ledgerline::timing
