#pragma once
#include <memory>
#include <string>

#include "chaincode/endorser/shell/service.hpp"
#include "chaincode/endorser/shell/settings.hpp"

namespace ledgerline::endorser {

/// The peer's service Endorser on a TLS endpoint of its own, for any client of Fabric. Destruction gives open calls 0.2
/// s.
class Served {
 public:
  virtual ~Served() = default;
  virtual const std::string& endpoint() const = 0;
};
/// `service` must outlive it. `tls`: where a renewed pair of its certificate's file appears; it then listens again with
/// that pair, and gives open calls 0.2 s. An error names the key of `table` ("serve.", "own_endorser.") that is wrong.
Result<std::unique_ptr<Served>> serve(Service& service, const ServeSettings& settings, const std::string& table,
                                      std::shared_ptr<const fabric::TlsPairsInUse> tls);

}  // namespace ledgerline::endorser
