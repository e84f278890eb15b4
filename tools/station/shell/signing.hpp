#pragma once
#include <functional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "tools/station/shell/options.hpp"

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
/// `--wait`: until `is_there` says so of what `target` answers, an error, SIGINT, or the time is over. `what`: of the
/// errors.
Status wait_until(Station& station, const std::string& target, const std::string& what, TimeNs limit_ns,
                  const std::function<Result<bool>(std::string_view body)>& is_there);
/// The number of the station's newest event.
Result<std::uint64_t> newest_event(Station& station);
/// As wait_until() of the drones' table; an error too is an event behind `number` about one of `names` (empty: any)
/// that has `refusal` in it: its text.
Status wait_or_hear(Station& station, const std::vector<std::string>& names, const std::string& refusal,
                    std::uint64_t number, const std::string& what, TimeNs limit_ns,
                    const std::function<Result<bool>(std::string_view drones)>& is_there);
/// Approves a mission, and waits until the station counts it, so that a start may follow; or until it is refused. How
/// that went: who has approved before, and still counts, need not again.
Result<std::string> approve_and_wait(Station& station, const std::string& id);

}  // namespace ledgerline::station
