#pragma once
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

/// A SetCall's bytes, written and read in place: no message is copied into an object and out again.
namespace ledgerline::bridge {

struct Origin {
  std::uint64_t writer = 0;  ///< 0: none, so not of a bridge
  std::uint64_t life = 0, sequence = 0;
  TimeNs stamp_ns = 0;  ///< real time, the origin's clock
};

/// One asset, as views into the bytes that it was read from.
struct AssetView {
  std::string_view id, type, cdr;
  Origin origin;
};

/// Bytes that append_asset writes at most, beyond those of id, type and CDR.
inline constexpr std::size_t asset_overhead = 64;

/// One more asset behind a SetCall's bytes.
void append_asset(std::string& call, const AssetView& asset);
/// SetCall.stream = true.
void append_stream(std::string& call);

struct SetView {
  std::vector<AssetView> assets;
  bool stream = false;
};
/// Reads a SetCall in protobuf; fields that a newer version has are passed over. What is cut off or damaged is an
/// error, and `out` is empty.
Status read_set(std::string_view call, SetView& out);

/// Counts by reason, those that are not 0, for reports. `name(Why)` names one.
template <typename Why, std::size_t count>
nlohmann::json reasons(const std::array<std::uint64_t, count>& counts) {
  nlohmann::json out = nlohmann::json::object();
  for (std::size_t i = 0; i < count; ++i) {
    if (counts[i] > 0) out[std::string(name(static_cast<Why>(i)))] = counts[i];
  }
  return out;
}

}  // namespace ledgerline::bridge
