#include "common/fabric/stream/reported_headers.hpp"

#include <utility>

namespace ledgerline::fabric {
namespace {

template <typename Kept>
void keep(std::map<std::uint64_t, Kept>& kept, std::uint64_t number, Kept one) {
  kept.insert_or_assign(number, std::move(one));
  if (kept.size() > ReportedHeaders::max_kept) kept.erase(kept.begin());
}

template <typename Kept>
std::optional<Kept> take(std::map<std::uint64_t, Kept>& kept, std::uint64_t number) {
  auto node = kept.extract(number);
  return node.empty() ? std::nullopt : std::optional(std::move(node.mapped()));
}

}  // namespace

void ReportedHeaders::ordered(const common::Block& message, std::string hash) {
  Ordered one{std::move(hash), {}};
  *one.message.mutable_header() = message.header();
  // Of the metadata what is signed, and the signatures.
  const auto& metadata = message.metadata().metadata();
  if (metadata.size() > common::SIGNATURES && metadata[common::SIGNATURES].size() <= max_signatures_bytes)
    *one.message.mutable_metadata()->add_metadata() = metadata[common::SIGNATURES];
  keep(ordered_, message.header().number(), std::move(one));
}

void ReportedHeaders::forget_ordered() { ordered_.clear(); }

void ReportedHeaders::of_peer(std::uint64_t number, std::string hash) { keep(of_peer_, number, std::move(hash)); }

std::optional<ReportedHeaders::Ordered> ReportedHeaders::take_ordered(std::uint64_t number) {
  return take(ordered_, number);
}

std::optional<std::string> ReportedHeaders::take_of_peer(std::uint64_t number) { return take(of_peer_, number); }

}  // namespace ledgerline::fabric
