#include "common/fabric/tx/validated_share.hpp"

#include <utility>

namespace ledgerline::fabric {

void ValidatedShare::add(TimeNs now, const Block& block) {
  for (const Transaction& tx : block.transactions) {
    if (tx.config) continue;
    ++(tx.by_flag ? by_flag_ : validated_);
    ++now_.of;
    if (tx.by_flag) ++now_.by_flag;
  }
  if (now - begun_ns_ < window_ns) return;
  begun_ns_ = now;
  const Rise window = std::exchange(now_, {});
  if (window.of < fewest) return;
  if (low_ && 2 * window.by_flag > window.of) {
    rise_ = window;
    low_ = false;
  }
  if (4 * window.by_flag < window.of) low_ = true;
}

std::optional<ValidatedShare::Rise> ValidatedShare::take_rise() { return std::exchange(rise_, std::nullopt); }

}  // namespace ledgerline::fabric
