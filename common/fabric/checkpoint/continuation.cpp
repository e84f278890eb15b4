#include "common/fabric/checkpoint/continuation.hpp"

#include <fmt/format.h>

#include "common/fabric/tx/envelope.hpp"

namespace ledgerline::fabric {

Result<Continuation> continue_behind(const LastVerified& verified, const common::Block& newest,
                                     const std::function<Result<common::Block>(std::uint64_t number)>& fetch) {
  const Checkpoint& last = verified.last;
  const std::uint64_t height = newest.header().number();
  if (height < last.number)
    return Error{
        fmt::format("the peer serves a chain that ends at block {}; we have verified block {}: it lags behind, or "
                    "serves an old chain",
                    height, last.number)};
  std::string hash = header_hash(newest.header());
  if (height > last.number) {
    const auto block = fetch(last.number);
    if (!block) return block.error();
    if (header_hash(block->header()) != last.hash) hash.clear();
  } else if (hash != last.hash) {
    hash.clear();
  }
  if (hash.empty())
    return Error{fmt::format(
        "the peer serves another block {} than the one that we have verified: a fork, or the channel was recreated "
        "(then remove the checkpoint's file)",
        last.number)};
  if (height - last.number <= verified.max_absence_blocks)
    return Continuation{ChainCheck::behind(last.number, last.hash), last.number, height, false};
  return Continuation{ChainCheck::behind(height, std::move(hash)), last.number, height, true};
}

}  // namespace ledgerline::fabric
