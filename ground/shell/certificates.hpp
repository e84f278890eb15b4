#pragma once
#include <functional>
#include <memory>
#include <string>

#include "common/fabric/renewal/certificate_watch.hpp"
#include "ground/core/flight_types.hpp"
#include "ground/service/core/certificate_ends.hpp"

namespace ledgerline::ground {

/// Ground's and agents' certificates: renewals are taken while it flies, and their ends are logged and reported. The
/// flight's thread.
class Certificates {
 public:
  using Tell = std::function<void(Level level, const std::string& words)>;

  explicit Certificates(std::unique_ptr<fabric::CertificateWatch> watch) : watch_(std::move(watch)) {}
  /// `tell`: of ground's own; on the watch's thread.
  void start(Tell tell);
  /// A block, whose writers' certificates are looked at.
  void note(const fabric::Block& block) { ends_.note(block); }
  /// `tell`: of agents'.
  void step(TimeNs now_ns, const Tell& tell);
  /// Until the first of ground's own ends.
  std::int64_t days_left() const { return watch_->days_left(); }

 private:
  service::CertificateEnds ends_;
  TimeNs next_ns_ = 0;
  std::unique_ptr<fabric::CertificateWatch> watch_;
};

}  // namespace ledgerline::ground
