#include "chaincode/node/storage/block_store.hpp"

#include <algorithm>

#include "common/crypto/crypto.hpp"

namespace ledgerline::node {
namespace {

constexpr std::string_view file_magic = "LLF1", magic = "LLB1";
constexpr std::size_t salt_size = 16, check_size = 8;
constexpr std::size_t head_size = 4 + salt_size + check_size;
constexpr std::size_t header_size = 4 + 4 + 2 * check_size;

std::string check_of(std::string_view bytes) {
  const crypto::Digest digest = crypto::sha256(bytes);
  return {digest.begin(), digest.begin() + check_size};
}

std::string make_head() {
  const std::string salted = std::string(file_magic) + crypto::random_bytes(salt_size);
  return salted + check_of(salted);
}

bool is_head(std::string_view bytes) {
  return bytes.substr(0, 4) == file_magic && check_of(bytes.substr(0, 4 + salt_size)) == bytes.substr(4 + salt_size);
}

std::string make_header(const std::string& salt, std::string_view content) {
  std::string length;
  for (int shift = 0; shift < 32; shift += 8) length += static_cast<char>((content.size() >> shift) & 0xff);
  const std::string content_check = check_of(content);
  const std::string begin = std::string(magic) + length;
  return begin + check_of(salt + begin + content_check) + content_check;
}

struct Header {
  std::size_t size;
  std::string content_check;
};

std::optional<Header> read_header(const std::string& salt, std::string_view bytes) {
  if (bytes.size() < header_size || bytes.substr(0, 4) != magic) return std::nullopt;
  const std::string content_check(bytes.substr(8 + check_size, check_size));
  if (check_of(salt + std::string(bytes.substr(0, 8)) + content_check) != bytes.substr(8, check_size)) {
    return std::nullopt;
  }
  std::size_t size = 0;
  for (std::size_t i = 0; i < 4; ++i)
    size |= static_cast<std::size_t>(static_cast<unsigned char>(bytes[4 + i])) << (8 * i);
  return Header{size, content_check};
}

/// The record at `offset`: its content, nullopt when it is damaged or unfinished, an error when the disk fails.
Result<std::optional<std::string>> read_record(const File& file, const std::string& salt, std::uint64_t offset,
                                               std::uint64_t end) {
  const std::optional<std::string> none;
  if (end - offset < header_size) return none;
  const auto head = file.read(offset, header_size);
  if (!head) return head.error();
  const auto header = read_header(salt, *head);
  if (!header || end - offset - header_size < header->size) return none;
  auto content = file.read(offset + header_size, header->size);
  if (!content) return content.error();
  if (check_of(*content) != header->content_check) return none;
  return std::optional(std::move(*content));
}

}  // namespace

Result<std::unique_ptr<BlockStore>> BlockStore::open(Files& files, const OnBlock& on_block,
                                                     const OnMessage& on_message) {
  const std::string name = "blocks";
  auto file = files.open(name);
  if (!file) return file.error();
  std::unique_ptr<BlockStore> store(new BlockStore(std::move(*file), files.place() + "/" + name));
  if (Status status = store->load(on_block, on_message); !status) return status.error();
  return store;
}

Status BlockStore::load(const OnBlock& on_block, const OnMessage& on_message) {
  const auto size = file_->size();
  if (!size) return size.error();
  if (Status status = open_head(*size, on_message); !status) return status;
  while (end_ < *size) {
    const auto content = read_record(*file_, salt_, end_, *size);
    if (!content) return content.error();
    if (!*content) break;
    if (Status status = on_block(**content); !status) return Error{name_ + ": " + status.error().message};
    extents_.push_back({end_ + header_size, (*content)->size()});
    end_ += header_size + (*content)->size();
  }
  if (end_ > *size) return done;  // just begun
  // What was written before a kill may be in the page cache alone; readers are about to be notified of it.
  if (end_ == *size) return file_->sync();

  const auto behind = record_behind(end_ + 1, *size);
  if (!behind) return behind.error();
  if (*behind) {
    return Error{name_ + " is damaged at byte " + std::to_string(end_) + " (block " + std::to_string(extents_.size()) +
                 "), with good blocks behind it: this was no crash. Restore the file from a copy"};
  }
  on_message(name_ + ": block " + std::to_string(extents_.size()) + " was not finished when the node last stopped; " +
             std::to_string(*size - end_) + " bytes cut off");
  if (Status status = file_->truncate(end_); !status) return status;
  return file_->sync();
}

Status BlockStore::open_head(std::uint64_t size, const OnMessage& on_message) {
  end_ = head_size;
  if (size >= head_size) {
    auto head = file_->read(0, head_size);
    if (!head) return head.error();
    if (is_head(*head)) {
      salt_ = head->substr(4, salt_size);
      return done;
    }
  }
  if (size > 0) {
    // Nothing is written behind a head before it is synced. An unfinished one is a begin of ours, or zeros.
    const auto begin = file_->read(0, std::min<std::uint64_t>(size, file_magic.size()));
    if (!begin) return begin.error();
    const bool ours = file_magic.starts_with(*begin) || begin->find_first_not_of('\0') == std::string::npos;
    if (size > head_size || !ours) {
      return Error{name_ +
                   " is damaged at byte 0, or no ledger of this version of the program: restore it from a copy"};
    }
    on_message(name_ + " was not begun when the node last stopped; " + std::to_string(size) + " bytes cut off");
    if (Status status = file_->truncate(0); !status) return status;
  }
  const std::string head = make_head();
  salt_ = head.substr(4, salt_size);
  if (Status status = file_->append(head); !status) return status;
  return file_->sync();
}

Result<bool> BlockStore::record_behind(std::uint64_t offset, std::uint64_t end) const {
  constexpr std::uint64_t step = 1 << 20;
  for (std::uint64_t at = offset; at < end; at += step) {
    // Overlapping by the length of the magic, so that none is missed at an edge.
    const auto bytes = file_->read(at, std::min(step + magic.size() - 1, end - at));
    if (!bytes) return bytes.error();
    for (auto found = bytes->find(magic); found != std::string::npos; found = bytes->find(magic, found + 1)) {
      const auto content = read_record(*file_, salt_, at + found, end);
      if (!content) return content.error();
      if (*content) return true;
    }
  }
  return false;
}

Status BlockStore::append(std::string_view block) {
  if (broken_) return Error{name_ + " takes no more blocks after an error"};
  broken_ = true;
  full_ = false;
  if (block.size() > UINT32_MAX) return Error{"a block of " + std::to_string(block.size()) + " bytes is too long"};
  std::string record = make_header(salt_, block);
  record.append(block);
  if (Status status = file_->append(record); !status) {
    full_ = file_->full() && file_->truncate(end_);
    broken_ = !full_;
    return status;
  }
  if (Status status = file_->sync(); !status) return status;
  broken_ = false;
  const std::lock_guard lock(mutex_);
  extents_.push_back({end_ + header_size, block.size()});
  end_ += record.size();
  return done;
}

Result<std::string> BlockStore::read(std::uint64_t number) const {
  Extent extent{};
  {
    const std::lock_guard lock(mutex_);
    if (number >= extents_.size()) return Error{"there is no block " + std::to_string(number)};
    extent = extents_[number];
  }
  return file_->read(extent.offset, extent.size);
}

std::uint64_t BlockStore::height() const {
  const std::lock_guard lock(mutex_);
  return extents_.size();
}

}  // namespace ledgerline::node
