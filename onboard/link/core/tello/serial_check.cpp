#include "onboard/link/core/tello/serial_check.hpp"

#include <algorithm>

namespace ledgerline::link {
namespace {

// An answer takes tens of ms: half would ask twice on a slow radio, double delays a first take-off by a lost datagram.
constexpr TimeNs repeat_ns = 500 * ns_per_ms;
// One may be the late answer to what link sent without state before; double delays such a drone's take-off.
constexpr int refusals_needed = 3;
constexpr std::size_t min_serial = 4;

}  // namespace

bool is_serial(std::string_view text) noexcept {
  return text.size() >= min_serial && text.size() <= SerialText{}.bytes.size() &&
         std::all_of(text.begin(), text.end(),
                     [](char c) { return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z'); });
}

SerialCheck::SerialCheck(std::string_view wanted) noexcept
    : wanted_(wanted), verdict_(wanted.empty() ? Verdict::unwanted : Verdict::open) {}

void SerialCheck::begin() noexcept {
  if (verdict_ == Verdict::unwanted) return;
  verdict_ = Verdict::open;
  asked_ns_ = 0;
  refusals_ = 0;
}

bool SerialCheck::request_if_due(TimeNs now) noexcept {
  if (verdict_ != Verdict::open || (asked_ns_ != 0 && now - asked_ns_ < repeat_ns)) return false;
  asked_ns_ = now;
  return true;
}

bool SerialCheck::on_answer(std::string_view bytes) noexcept {
  if (verdict_ != Verdict::open || asked_ns_ == 0) return false;
  const std::string_view text = without_line_end(bytes);
  if (parse_answer(text) == Answer::refused) {
    if (++refusals_ >= refusals_needed) verdict_ = Verdict::unreported;
    return true;
  }
  if (!is_serial(text)) return false;
  answered_ = SerialText(text);
  verdict_ = text == wanted_.view() ? Verdict::same : Verdict::other;
  return true;
}

}  // namespace ledgerline::link
