#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"
#include "common/web/host_port.hpp"
#include "common/web/tls_files.hpp"

namespace ledgerline::ground::service {

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
struct Fault {
  std::string key, what;
};
/// Of settings with a `listen`.
std::vector<Fault> faults_of(const ServiceSettings& settings);

/// What Host may say of a server with good settings that listens on `port`.
std::vector<std::string> hosts_of(const ServiceSettings& settings, std::uint16_t port);
/// "https://ground.example.org:8800": where a browser finds it, by the first of its names.
std::string url_of(const ServiceSettings& settings, std::uint16_t port);

}  // namespace ledgerline::ground::service
