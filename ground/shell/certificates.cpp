#include "ground/shell/certificates.hpp"

#include "common/base/log.hpp"

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

void Certificates::start(Tell tell) {
  watch_->start([tell = std::move(tell)](fabric::CertificateWatch::Weight weight, const std::string& words) {
    fabric::CertificateWatch::log(weight, words);
    tell(level_of(weight), words);
  });
}

void Certificates::step(TimeNs now_ns, const Tell& tell) {
  if (now_ns < next_ns_) return;
  next_ns_ = now_ns + look_period_ns;
  for (const crypto::Renewal::Notice& word : ends_.look(realtime_ns() / ns_per_s)) {
    spdlog::warn("{}", word.words);
    tell(level_of(word.weight), word.words);
  }
}

}  // namespace ledgerline::ground
