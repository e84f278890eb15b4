#include "tools/audit/source.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <optional>

#include "chaincode/node/storage/block_store.hpp"
#include "common/base/file.hpp"

namespace ledgerline::audit {
namespace {

namespace fs = std::filesystem;

const Error read_only{"a copy is not written to"};

/// A file of a node's storage that stays as it is. What BlockStore would cut off stays there and is reported.
class ReadOnlyFile final : public node::File {
 public:
  ReadOnlyFile(int file, std::string path) : file_(file), path_(std::move(path)) {}
  ~ReadOnlyFile() override { ::close(file_); }
  ReadOnlyFile(const ReadOnlyFile&) = delete;
  ReadOnlyFile& operator=(const ReadOnlyFile&) = delete;

  Status append(std::string_view) override { return read_only; }
  Status sync() override { return done; }
  Status truncate(std::uint64_t) override { return done; }
  Result<std::string> read(std::uint64_t offset, std::size_t size) const override {
    std::string bytes(size, '\0');
    for (std::size_t at = 0; at < size;) {
      const ssize_t got = ::pread(file_, bytes.data() + at, size - at, static_cast<off_t>(offset + at));
      if (got <= 0) return Error{path_ + ": cannot be read"};
      at += static_cast<std::size_t>(got);
    }
    return bytes;
  }
  Result<std::uint64_t> size() const override {
    struct stat status {};
    if (::fstat(file_, &status) != 0) return Error{path_ + ": has no size"};
    return static_cast<std::uint64_t>(status.st_size);
  }

 private:
  int file_;
  std::string path_;
};

/// The one file that was named, whatever its name.
class OneFile final : public node::Files {
 public:
  explicit OneFile(std::string path) : path_(std::move(path)) {}
  Result<std::unique_ptr<node::File>> open(const std::string&) override {
    const int file = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) return Error{path_ + ": cannot be read"};
    return std::unique_ptr<node::File>(std::make_unique<ReadOnlyFile>(file, path_));
  }
  std::string place() const override { return ""; }  // read_store() puts the path into messages

 private:
  std::string path_;
};

Result<Reading> read_store(const std::string& path, const OnBlock& on_block) {
  Reading reading;
  OneFile file(path);
  const auto store = node::BlockStore::open(
      file,
      [&](std::string_view block) -> Status {
        ++reading.blocks;
        on_block(block);
        return done;
      },
      [&](const std::string&) { reading.problem = "the copy ends in the middle of this block"; });
  if (store) return reading;
  std::string why = store.error().message;
  if (why.starts_with("/blocks")) why.replace(0, std::string_view("/blocks").size(), path);
  if (reading.blocks == 0) return Error{why};
  reading.problem = std::move(why);
  return reading;
}

std::string name_of(std::uint64_t number) { return fmt::format("{}.block", number); }

/// The highest N of all N.block.
Result<std::optional<std::uint64_t>> newest_in(const std::string& folder) {
  std::optional<std::uint64_t> newest;
  std::error_code failed;
  for (fs::directory_iterator it(folder, failed), end; !failed && it != end; it.increment(failed)) {
    const std::string stem = it->path().stem().string();
    const bool number = !stem.empty() && stem.size() <= 18 && stem.find_first_not_of("0123456789") == std::string::npos;
    if (it->path().extension() == ".block" && number)
      newest = std::max(newest.value_or(0), std::uint64_t{std::stoull(stem)});
  }
  if (failed) return Error{folder + ": " + failed.message()};
  return newest;
}

Result<Reading> read_folder(const std::string& folder, std::uint64_t newest, const OnBlock& on_block) {
  Reading reading;
  for (std::uint64_t number = 0; number <= newest; ++number) {
    const auto block = read_file((fs::path(folder) / name_of(number)).string());
    if (!block) {
      if (newest == 0) return block.error();
      reading.problem = fmt::format("{}, and the copy goes on to block {}", block.error().message, newest);
      return reading;
    }
    ++reading.blocks;
    on_block(*block);
  }
  return reading;
}

/// Why a folder without blocks is no copy. A Fabric network keeps them in its peers, whose files nothing here reads.
std::string no_copy_text(const std::string& path) {
  std::error_code failed;
  for (const fs::path& network : {fs::path(path) / "ledger", fs::path(path)}) {
    if (!fs::is_directory(network / "done", failed)) continue;
    return fmt::format(
        "{}: it has no copy of the chain, since the flight was on Fabric. `ledgerline fabric up --dir {}` serves it "
        "again; then `ledgerline audit --config {} --save copy` audits it, and --blocks takes that copy",
        path, network.string(), (network / ".." / "operator.toml").lexically_normal().string());
  }
  return path + ": has neither a file \"blocks\" nor 0.block, 1.block ...";
}

}  // namespace

Result<Reading> read_copy(const std::string& path, const OnBlock& on_block) {
  std::error_code failed;
  const fs::file_type type = fs::status(path, failed).type();
  if (type == fs::file_type::regular) return read_store(path, on_block);
  if (type != fs::file_type::directory) return Error{path + ": " + (failed ? failed.message() : "no file or folder")};
  for (const char* inside :
       {"blocks", "ledger/blocks", "ledger/ledger/blocks"}) {  // the node's folders, and a flight's
    const std::string file = (fs::path(path) / inside).string();
    if (fs::is_regular_file(file, failed)) return read_store(file, on_block);
  }
  const auto newest = newest_in(path);
  if (!newest) return newest.error();
  if (!*newest) return Error{no_copy_text(path)};
  return read_folder(path, **newest, on_block);
}

Status save_block(const std::string& folder, std::uint64_t number, std::string_view block) {
  return write_file((fs::path(folder) / name_of(number)).string(), block);
}

}  // namespace ledgerline::audit
