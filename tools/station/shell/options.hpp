#pragma once
#include <functional>
#include <memory>
#include <string>

#include "common/base/result.hpp"
#include "common/program/command_line.hpp"
#include "common/rt/clock.hpp"
#include "common/web/host_port.hpp"
#include "tools/station/core/requests.hpp"

namespace ledgerline::station {

/// How a client shows who it is, and whom it trusts.
struct Credentials {
  std::string token;         ///< of the page; 64 hex digits
  std::string session;       ///< of an operator; empty: nobody is signed in
  std::string session_file;  ///< where that came from, for errors
  web::TlsFiles tls{};       ///< of a station with TLS
  std::string token_file{};  ///< where the token came from, for errors
  std::string hint{};        ///< behind the error that it is not reached
};

/// A client of one station: requests one after the other over one connection, which is reopened where the station has
/// closed it. Each call waits, some seconds at most. One thread.
class Station {
 public:
  /// An error: a file of TLS.
  static Result<std::unique_ptr<Station>> open(StationAddress address, Credentials credentials);
  ~Station();

  /// The answer's body; what the station refuses is an error in its words. An operator's session that is over keeps
  /// nobody from landing or stopping a drone: what is anybody's is then asked with the page's token.
  Result<std::string> request(const Request& request);
  /// How many connections were made for requests: one more, and the station may be another than before.
  unsigned connections() const;

 private:
  struct Client;
  Station(StationAddress address, Credentials credentials, std::unique_ptr<Client> client);
  Result<Answer> send(const Request& request, const std::string& token);

  const StationAddress address_;
  const Credentials credentials_;
  std::unique_ptr<Client> client_;
};

/// What every program of the station's command line takes.
struct Options {
  std::string url, token_file, config, session_file;
  web::TlsFiles tls{};
  bool json = false;
  bool signs_in = false;  ///< which makes the session's file
};
void add_options(CommandLine& line, Options& options);
/// For notes: the environment, and the exit codes.
extern const char* const shared_notes;

/// Which station, and the files that open it.
struct Target {
  StationAddress address;
  std::string token_file, session_file;  ///< no session file: nobody signs in
  bool session_expected = false;         ///< an option names its file, and it is not about to be made
  bool token_named = false;              ///< by an option, not by a config or by default
  web::TlsFiles tls{};
  std::string hint{};  ///< of a station that nobody has named: what names it
};
/// By the options, else a config's [service], else the environment, else this user's flight (flight_link). An error is
/// bad usage.
using Environment = std::function<std::string(const char* name)>;  ///< empty: not set
Result<Target> target_of(const Options& options, const Environment& environment);
Result<Target> target_of(const Options& options);  ///< by this process's environment

/// With the page's token, and the operator's session if there is one. A session that cannot be read is a warning, so
/// that it does not keep a drone in the air.
Result<std::unique_ptr<Station>> open(const Target& target);

/// The rest of a program: acts at the station that the options name; the exit code.
int run(const Options& options, const std::function<Status(Station& station, const Target& target)>& act);

/// Prints a table, on a terminal in the place of what was there.
void print_refreshed(const std::string& text);
/// Sleeps; less when a signal asks to end.
void rest(TimeNs duration_ns);
/// "14:05:09" of the ground's clock, by this computer's.
std::string time_of_day(double t_ms, double now_ms);

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
