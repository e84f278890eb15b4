#pragma once
#include <memory>
#include <string>

#include "common/base/result.hpp"
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

}  // namespace ledgerline::station
