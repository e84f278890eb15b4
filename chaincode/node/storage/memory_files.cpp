#include "chaincode/node/storage/files.hpp"

namespace ledgerline::node {
namespace {

class MemoryFile final : public File {
 public:
  MemoryFile(std::string name, std::shared_ptr<MemoryFiles::Content> content)
      : name_(std::move(name)), content_(std::move(content)) {}

  Status append(std::string_view bytes) override {
    const std::size_t left = content_->room - std::min(content_->room, content_->bytes.size());
    full_ = left < bytes.size();
    content_->bytes.append(bytes.substr(0, left));
    if (full_) return Error{name_ + " has no room"};
    return done;
  }
  bool full() const override { return full_; }
  Status sync() override {
    content_->synced = content_->bytes.size();
    return done;
  }
  Result<std::string> read(std::uint64_t offset, std::size_t size) const override {
    if (offset + size > content_->bytes.size()) return Error{name_ + " is too short"};
    return content_->bytes.substr(offset, size);
  }
  Result<std::uint64_t> size() const override { return std::uint64_t{content_->bytes.size()}; }
  Status truncate(std::uint64_t size) override {
    content_->bytes.resize(size);
    content_->synced = std::min<std::size_t>(content_->synced, size);
    return done;
  }

 private:
  std::string name_;
  bool full_ = false;
  std::shared_ptr<MemoryFiles::Content> content_;
};

}  // namespace

Result<std::unique_ptr<File>> MemoryFiles::open(const std::string& name) {
  auto& content = (*contents_)[name];
  if (!content) content = std::make_shared<Content>();
  return std::unique_ptr<File>(std::make_unique<MemoryFile>(name, content));
}

void MemoryFiles::cut_power() {
  for (auto& [name, content] : *contents_) content->bytes.resize(content->synced);
}

}  // namespace ledgerline::node
