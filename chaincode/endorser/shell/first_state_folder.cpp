#include "chaincode/endorser/shell/first_state_folder.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <string_view>
#include <utility>

#include "common/base/file.hpp"

namespace ledgerline::endorser {
namespace {

namespace file = peer_snapshot_file;

// The ids of some 60 million transactions: a fleet's of years. All files are held in memory while they are read, so that
// twice as much asks for a host of its own.
constexpr std::int64_t max_file_bytes = std::int64_t{4} << 30;

/// Whoever may write it decides what is endorsed.
Status check(const std::string& path, bool folder) {
  struct stat is {};
  if (::stat(path.c_str(), &is) != 0 || (folder ? !S_ISDIR(is.st_mode) : !S_ISREG(is.st_mode)))
    return Error{fmt::format("{}: there is no such {}", path, folder ? "folder" : "file")};
  if ((is.st_mode & (S_IWGRP | S_IWOTH)) != 0)
    return Error{fmt::format(
        "{}: others than its owner may write it, and it decides what is endorsed; run: chmod go-w {}", path, path)};
  if (!folder && is.st_size > max_file_bytes)
    return Error{fmt::format("{}: it has {} bytes, and at most {} are read", path, is.st_size, max_file_bytes)};
  return done;
}

}  // namespace

std::string refused_first_state(const std::string& why) {
  return "first_state: " + why +
         ". Ask the peer for a snapshot anew (peer snapshot submitrequest) and copy its whole folder; or leave "
         "first_state out: then the chain is read from its first block";
}

Result<PeerSnapshot> read_first_state_folder(const FirstStateSettings& settings,
                                             const fabric::ChannelAndContract& where) {
  const auto refused = [](const std::string& why) { return Error{refused_first_state(why)}; };
  if (Status there = check(settings.folder, true); !there) return refused(there.error().what);
  PeerSnapshotFiles files;
  for (const auto& [name, content] : {std::pair{file::description, &files.description},
                                      {file::description_hash, &files.description_hash},
                                      {file::states, &files.states},
                                      {file::states_counts, &files.states_counts},
                                      {file::ids, &files.ids},
                                      {file::ids_count, &files.ids_count}}) {
    const std::string path = settings.folder + "/" + std::string(name);
    if (Status there = check(path, false); !there) return refused(there.error().what);
    auto read = read_file(path);
    if (!read) return refused(read.error().what + ", or it is empty");
    *content = std::move(*read);
  }
  auto said = read_peer_snapshot(files, where, settings.hash);
  if (!said) return refused(settings.folder + "/" + said.error().what);
  return said;
}

}  // namespace ledgerline::endorser
