#pragma once
#include <string>

#include "common/base/result.hpp"
#include "common/web/host_port.hpp"
#include "ground/mission/mission.hpp"
#include "ground/service/core/guard.hpp"

/// What the station is asked (docs/station.md), and what its answers look like to a person. Pure; any thread.
namespace ledgerline::station {

struct Request {
  std::string method = "GET";
  std::string target;  ///< below /api/v1/
  std::string body{};
  std::string content_type = "application/json";
  bool anybodys = true;  ///< any client that knows the page's token gets an answer: what reads, lands and stops
};

struct Answer {
  unsigned status = 0;
  std::string body;
};

/// `verb`: "takeoff", "land", "hand_over" ... as the API has them.
Request drone_request(const std::string& drone, const std::string& verb, std::string body = "{}");
Request stop_all();
/// `confirmed`: in the air, too.
Request cut_all(bool confirmed);
/// {"to":{...}} of hand_over and deny.
std::string to_body(const std::string& msp, const std::string& subject);
/// {"waypoints":[...]} of a CSV text, x,y[,z[,speed]] a line, in the map. The error names file and line.
Result<std::string> path_body(const std::string& csv, const std::string& file, bool land);

Request events_since(std::uint64_t number);
Request sign_in(const std::string& name, const std::string& pass_phrase);

/// `file` ends in .json or .csv; `name` is of CSV alone, which has none in it.
Result<Request> mission_to_add(const std::string& file, std::string text, const std::string& name);
/// What such a file holds, or what a station keeps of a mission (ID.json, ID.record.json): its digest is what missions
/// are approved by.
Result<ground::mission::Mission> mission_from(const std::string& file, const std::string& text,
                                              const std::string& name);
/// A mission's digest, and those that its approval and withdrawal have on the ledger (`ledgerline audit` lists them).
struct MissionDigests {
  std::string name, digest;
  std::string words, approval, withdrawal;  ///< empty: for no ground
};
/// `ground`: as the approval's words name it, "Org2MSP CN=station"; empty: none. `until_s`: when they let it end.
Result<MissionDigests> digests_of(const ground::mission::Mission& mission, const std::string& ground,
                                  std::int64_t until_s, std::int64_t lasts_s);

/// `verb`: "approve", "withdraw", "start", "pause", "resume", "land".
Request mission_request(const std::string& id, const std::string& verb);

/// An error: what the station said against a request.
Status check_answer(const Answer& answer);

/// Of a sign-in's answer.
struct Session {
  std::string token, name, identity;
};
Result<Session> session_from(const std::string& body);
/// Ground's own identity signs all there. Of GET operators.
bool nobody_signs_in(const std::string& body);
/// Who this client is signed in as; empty: nobody. Of GET operators.
Result<std::string> signed_in_as(const std::string& body);
/// The identity of who that is; empty: nobody's. Of GET operators.
Result<std::string> identity_signed_in(const std::string& body);

/// Where a station listens.
struct StationAddress {
  web::HostPort at;
  bool tls = false;
};
std::string text_of(const StationAddress& address);  ///< "127.0.0.1:8800"

/// Of "http://127.0.0.1:8800" or "https://ground.example.org:8800", with or without a "/" behind it. Without TLS it
/// must be this computer (localhost or a loopback address; the near end of an SSH tunnel is one).
Result<StationAddress> address_from_url(const std::string& url);
/// Of a ground's own settings: the first of its names, else what it listens on. Port 0 is one that nobody knows
/// beforehand.
Result<StationAddress> address_from_service(const ground::service::ServiceSettings& service);

/// The token of a page or a session, as a file has it: 64 hex digits.
bool is_token(const std::string& text);

}  // namespace ledgerline::station
