#include "chaincode/node/server/streams.hpp"

#include <limits>

namespace ledgerline::node {
namespace {

constexpr std::uint64_t no_end = std::numeric_limits<std::uint64_t>::max() - 1;

std::uint64_t place(const orderer::SeekPosition& position, std::uint64_t height, std::uint64_t otherwise) {
  switch (position.Type_case()) {
    case orderer::SeekPosition::kNewest:
      return height - 1;
    case orderer::SeekPosition::kOldest:
      return 0;
    case orderer::SeekPosition::kSpecified:
      return std::min(position.specified().number(), no_end);
    case orderer::SeekPosition::kNextCommit:
      return height;
    case orderer::SeekPosition::TYPE_NOT_SET:
      break;
  }
  return otherwise;
}

}  // namespace

std::uint64_t read_start(const orderer::SeekPosition& position, std::uint64_t height) {
  return place(position, height, height);
}

Result<SeekRange> read_range(const orderer::SeekInfo& seek, std::uint64_t height) {
  if (!seek.has_start() || !seek.has_stop()) return Error{"a seek needs start and stop"};
  SeekRange range;
  range.start = place(seek.start(), height, height);
  range.stop = place(seek.stop(), height, no_end);
  range.fail_if_not_ready = seek.behavior() == orderer::SeekInfo::FAIL_IF_NOT_READY;
  if (range.start > range.stop) return Error{"the seek's start is behind its stop"};
  return range;
}

Result<SeekRequest> read_seek(const common::Envelope& envelope) {
  SeekRequest request;
  common::Payload payload;
  common::ChannelHeader channel_header;
  common::SignatureHeader signature_header;
  if (!payload.ParseFromString(envelope.payload()) || !payload.has_header() ||
      !channel_header.ParseFromString(payload.header().channel_header()) ||
      !signature_header.ParseFromString(payload.header().signature_header()) ||
      !request.seek.ParseFromString(payload.data())) {
    return Error{"the seek does not parse"};
  }
  request.channel = channel_header.channel_id();
  request.creator = signature_header.creator();
  request.payload = envelope.payload();
  request.signature = envelope.signature();
  return request;
}

}  // namespace ledgerline::node
