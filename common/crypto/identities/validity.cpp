#include "common/crypto/identities/validity.hpp"

#include <fmt/format.h>

#include "common/base/printable.hpp"

namespace ledgerline::crypto {

std::int64_t days_left(std::int64_t not_after_s, std::int64_t now_s) {
  const std::int64_t left_s = not_after_s - now_s;
  return left_s >= 0 ? left_s / day_s : -((-left_s + day_s - 1) / day_s);
}

Ends ends(std::int64_t not_after_s, std::int64_t now_s) {
  const std::int64_t left = days_left(not_after_s, now_s);
  if (left < 0) return Ends::over;
  if (left < urgent_within_days) return Ends::urgent;
  return left < renew_within_days ? Ends::soon : Ends::later;
}

std::string end_in_words(const std::string& whose, std::int64_t not_after_s, std::int64_t now_s) {
  const std::int64_t left = days_left(not_after_s, now_s);
  if (left < 0) return fmt::format("the certificate of {} has ended", printable(whose));
  return fmt::format("the certificate of {} ends in {} {}", printable(whose), left, left == 1 ? "day" : "days");
}

}  // namespace ledgerline::crypto
