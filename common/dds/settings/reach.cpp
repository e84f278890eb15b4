#include "common/dds/settings/reach.hpp"

#include <filesystem>

namespace ledgerline::dds {
namespace {

// Discovery by multicast where lo can do it, and by unicast to the first participants of this host where it cannot: a
// fresh container's lo has no MULTICAST flag. Neither leaves the machine.
constexpr const char* loopback = R"(
<CycloneDDS><Domain id="any">
  <General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>31</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers>
  </Discovery>
</Domain></CycloneDDS>)";

}  // namespace

Reach reach_of(const ParticipantOptions& options, std::string_view uri) {
  if (!options.cyclonedds.empty()) {
    return {"file://" + std::filesystem::absolute(options.cyclonedds).string(),
            uri.empty() ? "" : "CYCLONEDDS_URI is set, but the config names " + options.cyclonedds + ", which decides"};
  }
  if (!options.local_only && uri.empty()) return {loopback, ""};
  if (!options.local_only) {
    return {
        std::nullopt,
        "CYCLONEDDS_URI decides how far DDS reaches, since the config says nothing: local_only = true in [dds] keeps "
        "it on this machine"};
  }
  if (*options.local_only) {
    return {loopback, uri.empty() ? ""
                                  : "CYCLONEDDS_URI is set, but the config says local_only = true: DDS stays on this "
                                    "machine"};
  }
  return {std::nullopt,
          uri.empty() ? "" : "DDS leaves this machine, as the config says, and CYCLONEDDS_URI decides how"};
}

}  // namespace ledgerline::dds
