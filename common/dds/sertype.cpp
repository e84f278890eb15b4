#include "common/dds/sertype.hpp"

#include <dds/ddsi/q_radmin.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>

namespace ledgerline::dds {
namespace {

constexpr std::size_t header_bytes = 4;
constexpr std::uint8_t padding_bits = 3;  // of the header's last byte: bytes at the end that are none of the message's

struct RawType : ddsi_sertype {
  std::shared_ptr<RefusedCounters> refused;
  std::uint32_t number = 0;
};

/// Followed by its bytes, in one block. On its way out they are whole words with the padding in the header, as they are
/// sent; on its way in the padding is taken off again.
struct RawMessage : ddsi_serdata {
  std::uint32_t size = 0;
  std::uint8_t* bytes() { return reinterpret_cast<std::uint8_t*>(this + 1); }
  const std::uint8_t* bytes() const { return reinterpret_cast<const std::uint8_t*>(this + 1); }
};

const RawMessage& raw(const ddsi_serdata* message) { return *static_cast<const RawMessage*>(message); }

RefusedCounters& counters(const ddsi_sertype* type) { return *static_cast<const RawType*>(type)->refused; }

constexpr std::size_t whole_words(std::size_t size) { return (size + 3) & ~std::size_t{3}; }

/// As Cyclone allocates its own messages: this is C's side.
RawMessage* make(const ddsi_sertype* type, ddsi_serdata_kind kind, std::size_t size) {
  void* const memory = std::malloc(sizeof(RawMessage) + whole_words(size));
  if (!memory) return nullptr;
  auto* message = new (memory) RawMessage;
  ddsi_serdata_init(message, type, kind);
  message->hash = type->serdata_basehash;
  message->size = static_cast<std::uint32_t>(size);
  std::memset(message->bytes() + size, 0, whole_words(size) - size);
  return message;
}

bool good_size(const ddsi_sertype* type, std::size_t size, std::size_t largest) {
  if (size < header_bytes) ++counters(type).malformed;
  if (size > largest) ++counters(type).too_long;
  return size >= header_bytes && size <= largest;
}

bool is_plain_cdr(const std::uint8_t* header) { return header[0] == 0 && header[1] <= 1; }

void free_message(ddsi_serdata* message) { std::free(static_cast<RawMessage*>(message)); }

/// From the network: `copy(bytes)` writes `size` bytes. What is refused is handed on empty: DDS would write a line to
/// its log for each message that it gets null for, and so let an outsider fill the disk.
template <typename Copy>
ddsi_serdata* receive(const ddsi_sertype* type, ddsi_serdata_kind kind, std::size_t size, Copy copy) {
  // Without a key, a message that has the key alone (a writer disposes of its instance) says nothing.
  if (kind != SDK_DATA) return make(type, kind, 0);
  if (!good_size(type, size, whole_words(max_message_bytes))) return make(type, kind, 0);
  RawMessage* message = make(type, kind, size);
  if (!message) return nullptr;
  std::uint8_t* bytes = message->bytes();
  copy(bytes);
  const std::size_t padding = bytes[3] & padding_bits;
  if (!is_plain_cdr(bytes) || size - header_bytes < padding) {
    ++counters(type).malformed;
    message->size = 0;
    return message;
  }
  bytes[3] &= static_cast<std::uint8_t>(~padding_bits);
  message->size -= static_cast<std::uint32_t>(padding);
  return message;
}

ddsi_serdata* from_fragments(const ddsi_sertype* type, ddsi_serdata_kind kind, const nn_rdata* fragments,
                             std::size_t size) {
  return receive(type, kind, size, [=](std::uint8_t* bytes) {
    std::size_t at = 0;
    for (const nn_rdata* f = fragments; f; f = f->nextfrag) {
      const std::size_t end = std::min<std::size_t>(f->maxp1, size);  // fragments may overlap
      if (end <= at) continue;
      std::memcpy(bytes + at, NN_RMSG_PAYLOADOFF(f->rmsg, NN_RDATA_PAYLOAD_OFF(f)) + (at - f->min), end - at);
      at = end;
    }
    std::memset(bytes + at, 0, size - at);
  });
}

ddsi_serdata* from_pieces(const ddsi_sertype* type, ddsi_serdata_kind kind, ddsrt_msg_iovlen_t count,
                          const ddsrt_iovec_t* pieces, std::size_t size) {
  return receive(type, kind, size, [=](std::uint8_t* bytes) {
    std::size_t at = 0;
    for (ddsrt_msg_iovlen_t i = 0; i < count && at < size; ++i) {
      const std::size_t part = std::min<std::size_t>(pieces[i].iov_len, size - at);
      std::memcpy(bytes + at, pieces[i].iov_base, part);
      at += part;
    }
    std::memset(bytes + at, 0, size - at);
  });
}

ddsi_serdata* from_key_hash(const ddsi_sertype* type, const ddsi_keyhash*) { return make(type, SDK_KEY, 0); }

std::uint32_t size_of(const ddsi_serdata* message) { return raw(message).size; }

void copy_out(const ddsi_serdata* message, std::size_t offset, std::size_t size, void* to) {
  std::memcpy(to, raw(message).bytes() + offset, size);
}

ddsi_serdata* lend(const ddsi_serdata* message, std::size_t offset, std::size_t size, ddsrt_iovec_t* to) {
  to->iov_base = const_cast<std::uint8_t*>(raw(message).bytes() + offset);
  to->iov_len = size;
  return ddsi_serdata_ref(message);
}

void give_back(ddsi_serdata* message, const ddsrt_iovec_t*) { ddsi_serdata_unref(message); }

/// Without a key all messages are of one instance.
bool same_key(const ddsi_serdata*, const ddsi_serdata*) { return true; }

ddsi_serdata* to_key(const ddsi_serdata* message) {
  RawMessage* key = make(message->type, SDK_KEY, 0);
  if (key) key->type = nullptr;  // it outlives the type
  return key;
}

void key_hash(const ddsi_serdata*, ddsi_keyhash* hash, bool) { std::memset(hash, 0, sizeof *hash); }

/// For Cyclone's own trace.
std::size_t print(const ddsi_sertype*, const ddsi_serdata* message, char* to, std::size_t room) {
  return static_cast<std::size_t>(std::snprintf(to, room, "%u bytes of CDR", raw(message).size));
}

/// Left null: samples that are C structs. Nothing here writes or takes those.
const ddsi_serdata_ops message_operations = [] {
  ddsi_serdata_ops ops{};
  ops.eqkey = same_key;
  ops.get_size = size_of;
  ops.from_ser = from_fragments;
  ops.from_ser_iov = from_pieces;
  ops.from_keyhash = from_key_hash;
  ops.to_ser = copy_out;
  ops.to_ser_ref = lend;
  ops.to_ser_unref = give_back;
  ops.to_untyped = to_key;
  ops.free = free_message;
  ops.print = print;
  ops.get_keyhash = key_hash;
  return ops;
}();

void free_type(ddsi_sertype* type) {
  ddsi_sertype_fini(type);
  delete static_cast<RawType*>(type);
}

const ddsi_sertype_ops type_operations = [] {
  ddsi_sertype_ops ops{};
  ops.version = ddsi_sertype_v0;
  ops.free = free_type;
  ops.equal = [](const ddsi_sertype* a, const ddsi_sertype* b) { return a == b; };
  // Each is equal to itself alone. Cyclone keeps them in a table that doubles itself, up to gigabytes, when more than a
  // few have one hash.
  ops.hash = [](const ddsi_sertype* type) { return static_cast<const RawType*>(type)->number * 0x9E3779B1U; };
  return ops;
}();

}  // namespace

ddsi_sertype* make_raw_type(const std::string& dds_type, std::shared_ptr<RefusedCounters> refused) {
  static std::atomic<std::uint32_t> made{0};
  auto* type = new RawType{};
  ddsi_sertype_init(type, dds_type.c_str(), &type_operations, &message_operations, true);
  type->refused = std::move(refused);
  type->number = ++made;
  return type;
}

ddsi_serdata* make_raw_message(const ddsi_sertype* type, std::span<const std::uint8_t> cdr) {
  if (!good_size(type, cdr.size(), max_message_bytes)) return nullptr;
  if (!is_plain_cdr(cdr.data())) {
    ++counters(type).malformed;
    return nullptr;
  }
  RawMessage* message = make(type, SDK_DATA, cdr.size());
  if (!message) return nullptr;
  std::memcpy(message->bytes(), cdr.data(), cdr.size());
  message->size = static_cast<std::uint32_t>(whole_words(cdr.size()));
  std::uint8_t& options = message->bytes()[3];
  options = static_cast<std::uint8_t>((options & ~padding_bits) | (message->size - cdr.size()));
  return message;
}

std::span<const std::uint8_t> bytes_of(const ddsi_serdata* message) {
  return {raw(message).bytes(), raw(message).size};
}

}  // namespace ledgerline::dds
