#include "common/program/recorder.hpp"

#include <utility>

#include "common/base/file.hpp"
#include "common/base/log.hpp"

namespace ledgerline {

Status Recorder::open(const std::string& trace_file) {
  if (trace_file.empty()) return done;
  auto trace = TraceWriter::create(trace_file);
  if (!trace) return trace.error();
  trace_file_ = trace_file;
  trace_ = std::move(trace).value();
  return done;
}

void Recorder::add(std::span<const TraceRecord> records) {
  if (!trace_) return;
  for (const TraceRecord& record : records) trace_->add(record);
}

Status Recorder::end(const std::string& summary_file, const std::function<std::string()>& summary) {
  if (trace_) {
    if (auto status = trace_->flush(); !status) return status;
    if (trace_->dropped() > 0) spdlog::warn("{}: {} records did not fit", trace_file_, trace_->dropped());
  }
  if (summary_file.empty()) return done;
  return write_file(summary_file, summary() + "\n");
}

}  // namespace ledgerline
