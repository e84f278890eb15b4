#pragma once
#include <cstdint>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline {

/// Of "2026-11-29T01:02:03Z", "2026-11-29T02:02:03+01:00" or seconds since 1970: these, real time; in ns they fit 64
/// bits.
Result<std::int64_t> parse_time_s(const std::string& text);
/// The same with up to nine digits behind the seconds' point ("2026-11-29T01:02:03.25Z"), in ns.
Result<std::int64_t> parse_time_ns(const std::string& text);

}  // namespace ledgerline
