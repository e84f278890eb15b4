// Ground's and agents' certificates: renewals are taken while it flies, and their ends are reported on the station.
#include "common/base/log.hpp"
#include "ground/shell/ground.hpp"

namespace ledgerline::ground {
namespace {

constexpr TimeNs look_period_ns = ns_per_s;  // ends are reported by the day

Level level_of(crypto::Renewal::Weight weight) {
  return weight == crypto::Renewal::Weight::alarm ? Level::alarm : Level::warning;
}

Level level_of(fabric::CertificateWatch::Weight weight) {
  switch (weight) {
    case fabric::CertificateWatch::Weight::info:
      return Level::info;
    case fabric::CertificateWatch::Weight::warning:
      return Level::warning;
    case fabric::CertificateWatch::Weight::alarm:
      break;
  }
  return Level::alarm;
}

}  // namespace

void Ground::start_certificates() {
  if (!certificates_) return;
  certificates_->start([this](fabric::CertificateWatch::Weight weight, const std::string& words) {
    fabric::CertificateWatch::log(weight, words);
    if (server_) mailbox_.put(Report{level_of(weight), "", words});
  });
}

void Ground::tell_certificates(TimeNs now_ns) {
  if (now_ns < next_certificates_ns_) return;
  next_certificates_ns_ = now_ns + look_period_ns;
  for (const crypto::Renewal::Word& word : certificate_ends_.look(realtime_ns() / ns_per_s)) {
    spdlog::warn("{}", word.words);
    if (server_) unshown_.push_back(board_.tell(now_ns, level_of(word.weight), "", word.words));
  }
}

}  // namespace ledgerline::ground
