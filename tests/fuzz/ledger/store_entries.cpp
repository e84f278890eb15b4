#include <algorithm>

#include "chaincode/node/storage/block_store.hpp"
#include "chaincode/node/storage/files.hpp"
#include "tests/fuzz/entry.hpp"

/// A ledger's file as a failing disk or a careless person may leave it.
namespace ledgerline::fuzz::store_part {
namespace {

using namespace node;

const std::string file_name = "blocks";

std::vector<std::string> good_blocks() {
  return {"the config block", std::string(300, 'a') + "LLB1", "", "three", std::string(40, '\0') + "four"};
}

/// Opens to the first of the good blocks, in order, and takes new ones; or refuses and says where. Never gives a block
/// that was not written.
class StoreEntry final : public Entry {
 public:
  std::vector<std::string> seeds() override {
    MemoryFiles files;
    for (const std::string& block : good_blocks()) {
      auto store = BlockStore::open(
          files, [](std::string_view) -> Status { return done; }, [](const std::string&) {});
      (void)(*store)->append(block);
      files_of_each_.push_back(files.content(file_name).bytes);
    }
    return {files_of_each_.begin() + 1, files_of_each_.end()};
  }

  Outcome feed(std::string_view bytes) override {
    MemoryFiles files;
    (void)files.open(file_name);
    files.content(file_name).bytes = bytes;
    const std::vector<std::string> good = good_blocks();
    std::size_t given = 0;
    bool strange = false;
    std::string message;
    const auto on_block = [&](std::string_view block) -> Status {
      strange = strange || given >= good.size() || block != good[given];
      ++given;
      return done;
    };
    auto store = BlockStore::open(files, on_block, [&](const std::string& m) { message += m; });
    // A splice of two of our files may hold blocks twice, whole: that is a file that was written, and it is for the
    // chain's own hashes to refuse it.
    if (!store) return refused(store.error().message);
    if ((*store)->height() != given) return refused("");
    const bool cut_off = files.content(file_name).bytes.size() < bytes.size();
    if (!(*store)->append("new")) return refused("");
    const auto last = (*store)->read(given);
    if (!last || *last != "new") return refused("");
    if (strange) return spliced(bytes) ? accepted() : refused("");
    return cut_off && message.empty() ? refused("") : accepted();
  }

 private:
  /// Holds only records of ours, so that each block that came out was written.
  bool spliced(std::string_view bytes) const {
    MemoryFiles files;
    (void)files.open(file_name);
    files.content(file_name).bytes = bytes;
    const std::vector<std::string> good = good_blocks();
    bool ours = true;
    (void)BlockStore::open(
        files,
        [&](std::string_view block) -> Status {
          ours = ours && std::find(good.begin(), good.end(), block) != good.end();
          return done;
        },
        [](const std::string&) {});
    return ours;
  }

  std::vector<std::string> files_of_each_;
};

const Registration store({"node.block_store", Kind::bytes, [] { return std::make_unique<StoreEntry>(); }});

}  // namespace
}  // namespace ledgerline::fuzz::store_part
