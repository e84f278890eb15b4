#pragma once
#include <cstdint>
#include <string>

/// How near a certificate is to its end, in one measure for doctor, status lines and alarms.
namespace ledgerline::crypto {

inline constexpr std::int64_t day_s = 86'400;
/// A month: an authority of another house, or one that is asked by mail, needs weeks.
inline constexpr std::int64_t renew_within_days = 30;
/// No flight should begin on a certificate that may end before somebody looks again after a weekend.
inline constexpr std::int64_t urgent_within_days = 3;

enum class Ends { later, soon, urgent, over };

/// Whole days until `not_after_s`; below 0: it has ended. Both are Unix time.
std::int64_t days_left(std::int64_t not_after_s, std::int64_t now_s);
Ends ends(std::int64_t not_after_s, std::int64_t now_s);
/// "the certificate of X ends in 12 days"; `whose` is made printable.
std::string end_in_words(const std::string& whose, std::int64_t not_after_s, std::int64_t now_s);

}  // namespace ledgerline::crypto
