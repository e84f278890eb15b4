#pragma once
#include <dds/dds.h>

#include <memory>

#include "common/base/result.hpp"
#include "common/dds/settings/reach.hpp"

namespace ledgerline::dds {

/// A domain made with a configuration that is not the environment's; deleting it ends DDS's threads in this process.
class OwnDomain {
 public:
  explicit OwnDomain(dds_entity_t handle) : handle_(handle) {}
  ~OwnDomain() { dds_delete(handle_); }
  OwnDomain(const OwnDomain&) = delete;
  OwnDomain& operator=(const OwnDomain&) = delete;

 private:
  dds_entity_t handle_;
};

struct MadeParticipant {
  std::shared_ptr<OwnDomain> domain;  ///< null: the environment's, or one that exists already by other means
  dds_entity_t handle = 0;
};

/// A participant in a domain that is made first where this process has none yet. What Cyclone says meanwhile goes into
/// the error, or else to the log. Thread-safe.
Result<MadeParticipant> make_participant(std::uint32_t domain, const Reach& reach, const dds_qos_t* qos);

}  // namespace ledgerline::dds
