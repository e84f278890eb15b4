#include "onboard/link/core/watch/client_watch.hpp"

namespace ledgerline::link {

void ClientWatch::on_text(TimeNs now) noexcept {
  const bool was_away = text_ns_ != 0 && command_ns_ - text_ns_ > away_ns;
  if (was_away && now - command_ns_ <= at_once_ns) returned_ns_ = {now, returned_ns_[0]};
  text_ns_ = now;
}

void ClientWatch::on_answer(TimeNs now) noexcept {
  if (now - text_ns_ > away_ns && answered_ns_ <= text_ns_) answered_ns_ = now;
}

}  // namespace ledgerline::link
