#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline::crypto {

/// Which authority's a revocation list is, and how new, as the list says itself.
struct ListOrigin {
  std::string issuer;                 ///< DER of its distinguished name
  std::optional<std::string> key_id;  ///< its authority key identifier; an organisation's authorities may share a name
  std::string number;                 ///< CRL number (RFC 5280, 5.2.3), big-endian without zeros in front; empty: none
  std::int64_t made_s = 0;            ///< Unix time
};
/// `entry`: PEM, of which the first list counts, or DER. An error: it cannot be read.
Result<ListOrigin> origin_of_list(const std::string& entry);
/// Whether a list of the one takes the place of one of the other: both are of the same key, or `old` does not say of
/// which.
bool is_of_same_authority(const ListOrigin& made, const ListOrigin& old);
/// By their numbers where both have one, else by their times. Two of one second are as new as each other.
bool is_older(const ListOrigin& made, const ListOrigin& other);

}  // namespace ledgerline::crypto
