#include "common/rt/trace.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace ledgerline {
namespace {

constexpr std::size_t buffered_records = 256;
constexpr TimeNs max_buffered_ns = ns_per_s;  // a reader that follows the file is not further behind

struct FileHeader {
  char magic[8] = {'L', 'L', 'T', 'R', 'A', 'C', 'E', '1'};
  std::uint64_t record_size = sizeof(TraceRecord);
};

Error file_error(const std::string& what, const std::string& path) {
  return Error{fmt::format("{} {}: {}", what, path, std::strerror(errno))};
}

Status write_all(int fd, const void* data, std::size_t size, const std::string& path) {
  const char* p = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t n = ::write(fd, p, size);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return file_error("cannot write trace", path);
    p += n;
    size -= static_cast<std::size_t>(n);
  }
  return done;
}

}  // namespace

Result<TraceWriter> TraceWriter::create(const std::string& path, std::uint64_t max_records) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) return file_error("cannot create trace", path);
  TraceWriter writer(fd, path, max_records);
  writer.buffer_.reserve(buffered_records);
  const FileHeader header;
  if (auto s = write_all(fd, &header, sizeof header, path); !s) return s.error();
  return writer;
}

TraceWriter::TraceWriter(TraceWriter&& other) noexcept { *this = std::move(other); }

TraceWriter& TraceWriter::operator=(TraceWriter&& other) noexcept {
  std::swap(fd_, other.fd_);
  std::swap(path_, other.path_);
  std::swap(buffer_, other.buffer_);
  std::swap(left_, other.left_);
  std::swap(dropped_, other.dropped_);
  return *this;
}

TraceWriter::~TraceWriter() {
  if (fd_ < 0) return;
  (void)flush();  // a failed flush has been reported by the flush before it; there is nobody left to report to here
  ::close(fd_);
}

void TraceWriter::add(const TraceRecord& record) {
  if (left_ == 0) {
    ++dropped_;
    return;
  }
  --left_;
  buffer_.push_back(record);
  // Halves: whatever is written, their difference does not overflow.
  const bool old = record.t_ns / 2 - buffer_.front().t_ns / 2 > max_buffered_ns / 2;
  if ((old || buffer_.size() >= buffered_records) && !flush())
    left_ = 0;  // a full disk: the rest is counted as dropped
}

Status TraceWriter::flush() {
  auto status = write_all(fd_, buffer_.data(), buffer_.size() * sizeof(TraceRecord), path_);
  if (!status) dropped_ += buffer_.size();
  buffer_.clear();
  return status;
}

Result<TraceReader> TraceReader::open(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return file_error("cannot open trace", path);
  TraceReader reader(fd, path);
  FileHeader header;
  const FileHeader expected;
  if (::read(fd, &header, sizeof header) != sizeof header || std::memcmp(&header, &expected, sizeof header) != 0) {
    return Error{fmt::format("{} is not a Ledgerline trace of this version", path)};
  }
  return reader;
}

TraceReader::~TraceReader() {
  if (fd_ >= 0) ::close(fd_);
}

Result<std::vector<TraceRecord>> TraceReader::read_new() {
  struct stat info {};
  const off_t at = ::lseek(fd_, 0, SEEK_CUR);
  if (at < 0 || ::fstat(fd_, &info) != 0) return file_error("cannot read trace", path_);
  std::vector<TraceRecord> records(static_cast<std::size_t>(std::max<off_t>(0, info.st_size - at)) /
                                   sizeof(TraceRecord));
  auto* p = reinterpret_cast<char*>(records.data());
  std::size_t left = records.size() * sizeof(TraceRecord);
  while (left > 0) {
    const ssize_t n = ::read(fd_, p, left);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return file_error("cannot read trace", path_);
    p += n;
    left -= static_cast<std::size_t>(n);
  }
  return records;
}

Result<std::vector<TraceRecord>> read_trace(const std::string& path) {
  auto reader = TraceReader::open(path);
  if (!reader) return reader.error();
  return reader->read_new();
}

}  // namespace ledgerline
