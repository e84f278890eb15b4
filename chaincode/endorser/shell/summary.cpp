#include "chaincode/endorser/shell/summary.hpp"

#include <nlohmann/json.hpp>

#include "common/base/file.hpp"

namespace ledgerline::endorser {

Status write_summary(const std::string& path, const Service::Counts& counts) {
  const nlohmann::json summary{{"blocks", counts.blocks},
                               {"answered", counts.answered},
                               {"sent_to_the_peer", counts.sent_to_the_peer},
                               {"checked", counts.checked},
                               {"same", counts.same},
                               {"other_state", counts.other_state},
                               {"peer_refused", counts.peer_refused},
                               {"apart", counts.apart},
                               {"not_checked", counts.not_checked},
                               {"differ", counts.differ},
                               {"restored", counts.restored},
                               {"joined", counts.joined}};
  return write_file(path, summary.dump(2) + "\n");
}

}  // namespace ledgerline::endorser
