#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/rt/clock.hpp"
#include "common/web/host_port.hpp"
#include "ground/service/core/api.hpp"
#include "ground/service/operators/sign_ins.hpp"

namespace ledgerline::ground::service {

inline constexpr std::size_t token_digits = 64;

/// What of a request's head decides whether it is heard.
struct Head {
  std::string_view host{}, origin{}, authorization{}, subprotocols{};
  bool websocket = false;
};

/// Who may send requests: a client that knows the token, or that of an operator's session, from a page that this server
/// served, or from no page. Host and Origin must name the server itself, exactly and with its port, so that neither
/// another site's script nor a name that was rebound to this address is accepted. Immutable; any thread.
class Guard {
 public:
  /// `token`: 64 hex digits. `hosts`: what Host may be, as hosts_of() has them. `tls`: pages are of https alone.
  Guard(std::string token, std::vector<std::string> hosts, bool tls);

  /// For the page's own files, which need no token: status 0, they may go out.
  ApiAnswer check_origin(const Head& head) const;
  /// For the API and the stream: status 0, the request is heard; `session`: that it belongs to. `session_ended`: it is
  /// refused, but may still bring drones down (ApiRequest::session_ended).
  struct Admission {
    ApiAnswer refused;
    std::optional<SignIns::Session> session{};
    bool session_ended = false;
  };
  /// What a token that is not the page's belongs to.
  struct Found {
    std::optional<SignIns::Session> session{};
    bool session_ended = false;
  };
  using FindSession = std::function<Found(std::string_view token)>;
  Admission check(const Head& head, const FindSession& find) const;

 private:
  bool is_own(std::string_view host) const;

  std::string token_;
  std::vector<std::string> hosts_;
  std::string_view scheme_;
};

/// A budget of requests for one connection: `per_s` a second, and as many at once. One thread.
class Budget {
 public:
  explicit Budget(double per_s) : per_s_(per_s), left_(per_s) {}
  bool spend(TimeNs now);

 private:
  double per_s_, left_;
  TimeNs last_ns_ = 0;
};

inline constexpr std::size_t max_names = 8;

/// [service] of ground.toml.
struct ServiceSettings {
  std::string listen{};              ///< "127.0.0.1:8800"; empty: no service
  std::string token_file{};          ///< 64 hex digits, mode 0600; made where it is missing
  web::TlsFiles tls{};               ///< without a certificate: no TLS, and of this computer alone
  std::vector<std::string> names{};  ///< hosts of the page's URL, beside what is listened on and localhost
  std::string operators{};           ///< folder of the operators' identities; empty: ground's own signs all
  TimeNs session_idle_ns = 0;
  std::string faults{};  ///< Unix socket of who switches a simulated flight's faults; empty: none are

  bool has_tls() const { return !tls.certificate.empty(); }
};

/// What is wrong with one key of them: "must ...".
struct SettingError {
  std::string key, what;
};
/// Of settings with a `listen`.
std::vector<SettingError> errors_of(const ServiceSettings& settings);

/// What Host may say of a server with good settings that listens on `port`.
std::vector<std::string> hosts_of(const ServiceSettings& settings, std::uint16_t port);
/// "https://ground.example.org:8800": where a browser finds it, by the first of its names.
std::string url_of(const ServiceSettings& settings, std::uint16_t port);

}  // namespace ledgerline::ground::service
