#include "chaincode/endorser/shell/first_state_folder.hpp"

#include <utility>

#include "common/base/file.hpp"

namespace ledgerline::endorser {
namespace {

namespace file = peer_snapshot_file;

// The ids of some 60 million transactions: a fleet's of years. All files are held in memory while they are read, so
// that twice as much asks for a host of its own.
constexpr std::int64_t max_file_bytes = std::int64_t{4} << 30;

}  // namespace

std::string refused_first_state(const std::string& why) {
  return "first_state: " + why +
         ". Ask the peer for a new snapshot (peer snapshot submitrequest) and copy its whole folder; or leave "
         "first_state out: then the chain is read from its first block";
}

Result<PeerSnapshot> read_first_state_folder(const FirstStateSettings& settings,
                                             const fabric::ChannelAndContract& where) {
  const auto refused = [](const std::string& why) { return Error{refused_first_state(why)}; };
  const auto folder = OwnedFolder::open(settings.folder);
  if (!folder) return refused(folder.error().message);
  PeerSnapshotFiles files;
  for (const auto& [name, content] : {std::pair{file::description, &files.description},
                                      {file::description_hash, &files.description_hash},
                                      {file::states, &files.states},
                                      {file::states_counts, &files.states_counts},
                                      {file::ids, &files.ids},
                                      {file::ids_count, &files.ids_count}}) {
    auto read = folder->read(std::string(name), max_file_bytes);
    if (!read) return refused(read.error().message);
    *content = std::move(*read);
  }
  auto said = read_peer_snapshot(files, where, settings.hash);
  if (!said) return refused(settings.folder + "/" + said.error().message);
  return said;
}

}  // namespace ledgerline::endorser
