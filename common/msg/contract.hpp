#pragma once
#include <cstddef>

#include "common/rt/clock.hpp"

/// Every limit of the contract, in one place. Beyond one a call is refused at endorsement with the limit named.
namespace ledgerline::chaincode {

inline constexpr std::size_t max_id_chars = 128;
inline constexpr std::size_t max_asset_bytes = 1'000'000;
inline constexpr std::size_t max_call_bytes = 1'000'000;
inline constexpr std::size_t max_call_assets = 1'000;
inline constexpr std::size_t max_frame_bytes = 32'000;
inline constexpr std::size_t max_drone_streams = 64;  ///< ids of one drone that stream
inline constexpr std::size_t max_page_versions = 64;  ///< old values of a key that one call looks at
inline constexpr std::size_t max_page_bytes = 1'000'000;
inline constexpr TimeNs max_plan_ns = 2 * ns_per_s;
inline constexpr std::size_t max_plan_setpoints = 40;

}  // namespace ledgerline::chaincode
