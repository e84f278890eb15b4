#include "common/bridge/core/set_call.hpp"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>

#include <array>
#include <bit>

#include "ledgerline.pb.h"

namespace ledgerline::bridge {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;
using google::protobuf::io::CodedOutputStream;

constexpr std::uint32_t bytes_tag(int field) {
  return WireFormatLite::MakeTag(field, WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
}
constexpr std::uint32_t fixed_tag(int field) {
  return WireFormatLite::MakeTag(field, WireFormatLite::WIRETYPE_FIXED64);
}
constexpr std::uint32_t varint_tag(int field) {
  return WireFormatLite::MakeTag(field, WireFormatLite::WIRETYPE_VARINT);
}

std::size_t field_size(std::string_view bytes) {  // every field number of ours is below 16: one byte
  return 1 + CodedOutputStream::VarintSize32(static_cast<std::uint32_t>(bytes.size())) + bytes.size();
}

void append_head(std::string& out, int field, std::size_t size) {
  std::array<std::uint8_t, 16> head{};
  std::uint8_t* end = CodedOutputStream::WriteTagToArray(bytes_tag(field), head.data());
  end = CodedOutputStream::WriteVarint32ToArray(static_cast<std::uint32_t>(size), end);
  out.append(reinterpret_cast<const char*>(head.data()), static_cast<std::size_t>(end - head.data()));
}

void append_bytes(std::string& out, int field, std::string_view bytes) {
  append_head(out, field, bytes.size());
  out.append(bytes);
}

/// The length-delimited field that comes next, as a view into `all`.
bool read_view(CodedInputStream& in, std::string_view all, std::string_view& view) {
  std::uint32_t size = 0;
  if (!in.ReadVarint32(&size)) return false;
  const auto at = static_cast<std::size_t>(in.CurrentPosition());
  if (size > all.size() - at) return false;
  view = all.substr(at, size);
  return in.Skip(static_cast<int>(size));
}

/// Each field of a message, one after the other: `read(tag, in)` is false of one that is damaged.
template <typename Read>
bool read_fields(std::string_view bytes, const Read& read) {
  CodedInputStream in(reinterpret_cast<const std::uint8_t*>(bytes.data()), static_cast<int>(bytes.size()));
  while (const std::uint32_t tag = in.ReadTag()) {
    if (!read(tag, in)) return false;
  }
  return in.ConsumedEntireMessage();
}

bool read_origin(std::string_view bytes, Origin& origin) {
  return read_fields(bytes, [&](std::uint32_t tag, CodedInputStream& in) {
    if (tag == fixed_tag(ledgerline::Origin::kWriterFieldNumber)) return in.ReadLittleEndian64(&origin.writer);
    if (tag == fixed_tag(ledgerline::Origin::kLifeFieldNumber)) return in.ReadLittleEndian64(&origin.life);
    if (tag == varint_tag(ledgerline::Origin::kSequenceFieldNumber)) return in.ReadVarint64(&origin.sequence);
    if (tag != fixed_tag(ledgerline::Origin::kStampNsFieldNumber)) return WireFormatLite::SkipField(&in, tag);
    std::uint64_t value = 0;
    const bool good = in.ReadLittleEndian64(&value);
    origin.stamp_ns = std::bit_cast<TimeNs>(value);
    return good;
  });
}

bool read_asset(std::string_view bytes, AssetView& asset) {
  return read_fields(bytes, [&](std::uint32_t tag, CodedInputStream& in) {
    std::string_view origin;
    if (tag == bytes_tag(Asset::kIdFieldNumber)) return read_view(in, bytes, asset.id);
    if (tag == bytes_tag(Asset::kMsgTypeFieldNumber)) return read_view(in, bytes, asset.type);
    if (tag == bytes_tag(Asset::kMsgDataFieldNumber)) return read_view(in, bytes, asset.cdr);
    if (tag != bytes_tag(Asset::kOriginFieldNumber)) return WireFormatLite::SkipField(&in, tag);
    return read_view(in, bytes, origin) && read_origin(origin, asset.origin);
  });
}

bool read_call(std::string_view bytes, SetView& out) {
  return read_fields(bytes, [&](std::uint32_t tag, CodedInputStream& in) {
    std::string_view asset;
    if (tag == bytes_tag(SetCall::kAssetsFieldNumber))
      return read_view(in, bytes, asset) && read_asset(asset, out.assets.emplace_back());
    if (tag != varint_tag(SetCall::kStreamFieldNumber)) return WireFormatLite::SkipField(&in, tag);
    std::uint64_t flag = 0;
    const bool good = in.ReadVarint64(&flag);
    out.stream = flag != 0;
    return good;
  });
}

}  // namespace

void append_asset(std::string& call, const AssetView& asset) {
  std::array<std::uint8_t, 48> origin{};
  std::uint8_t* end = origin.data();
  end = WireFormatLite::WriteFixed64ToArray(ledgerline::Origin::kWriterFieldNumber, asset.origin.writer, end);
  end = WireFormatLite::WriteFixed64ToArray(ledgerline::Origin::kLifeFieldNumber, asset.origin.life, end);
  end = WireFormatLite::WriteUInt64ToArray(ledgerline::Origin::kSequenceFieldNumber, asset.origin.sequence, end);
  end = WireFormatLite::WriteSFixed64ToArray(ledgerline::Origin::kStampNsFieldNumber, asset.origin.stamp_ns, end);
  const std::string_view origin_bytes(reinterpret_cast<const char*>(origin.data()),
                                      static_cast<std::size_t>(end - origin.data()));
  append_head(call, SetCall::kAssetsFieldNumber,
              field_size(asset.id) + field_size(asset.type) + field_size(asset.cdr) + field_size(origin_bytes));
  append_bytes(call, Asset::kIdFieldNumber, asset.id);
  append_bytes(call, Asset::kMsgTypeFieldNumber, asset.type);
  append_bytes(call, Asset::kMsgDataFieldNumber, asset.cdr);
  append_bytes(call, Asset::kOriginFieldNumber, origin_bytes);
}

void append_stream(std::string& call) {
  call.push_back(static_cast<char>(varint_tag(SetCall::kStreamFieldNumber)));
  call.push_back(1);
}

Status read_set(std::string_view call, SetView& out) {
  out.assets.clear();
  out.stream = false;
  if (call.size() <= INT32_MAX && read_call(call, out)) return done;
  out.assets.clear();
  return Error{"not a SetCall in protobuf"};
}

}  // namespace ledgerline::bridge
