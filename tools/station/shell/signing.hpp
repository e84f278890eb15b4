#pragma once
#include <string>

#include "common/base/result.hpp"
#include "tools/station/core/requests.hpp"
#include "tools/station/shell/options.hpp"
#include "tools/station/shell/station.hpp"

namespace ledgerline::station {

/// Opens an operator's session and keeps its token in target.session_file (0600), for the calls that follow.
Result<Session> open_session(Station& station, const Target& target, const std::string& name,
                             const std::string& pass_phrase);
/// Ends it: what its operator holds is landed and given back.
Status close_session(Station& station, const Target& target);

/// "acquire", "release", "request", "clear_stop", "hand_over", "deny".
bool is_signed_call(const std::string& verb);
/// Has the operator sign that for a drone, and waits until the ledger has taken it, or refused it with words.
Status call_and_wait(Station& station, const std::string& drone, const std::string& verb, const std::string& body);
/// Approves a mission, and waits until the station counts it, so that a start may follow; or until it is refused.
Status approve_and_wait(Station& station, const std::string& id);

}  // namespace ledgerline::station
