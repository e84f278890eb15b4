#include "ground/service/core/settings.hpp"

#include <fmt/format.h>

namespace ledgerline::ground::service {
namespace {

using web::HostKind;

std::string fault_of_listen(const ServiceSettings& settings) {
  const auto at = web::host_port_from(settings.listen);
  if (!at) return at.error().message;
  if (web::host_kind(at->host) == HostKind::name) return "must begin with an address of this computer, no name";
  if (!settings.has_tls() && !web::is_loopback(at->host))
    return "must be of this computer alone (127.0.0.1:PORT) without TLS: set tls_certificate and tls_key, or take an "
           "SSH tunnel from elsewhere";
  return "";
}

std::string fault_of_names(const ServiceSettings& settings) {
  if (!settings.names.empty() && !settings.has_tls())
    return "must not be there without tls_certificate: the page is of this computer alone then";
  for (const std::string& name : settings.names) {
    if (!web::host_kind(name) || web::is_any_address(name))
      return fmt::format("must be host names in lower case, or addresses, without a port; \"{}\" is none", name);
  }
  const auto at = web::host_port_from(settings.listen);
  if (at && web::is_any_address(at->host) && settings.has_tls() && settings.names.empty())
    return fmt::format("must say by which names or addresses the page is reached, since listen is {}", settings.listen);
  return "";
}

}  // namespace

std::vector<Fault> faults_of(const ServiceSettings& settings) {
  std::vector<Fault> faults;
  const auto add = [&](const char* key, std::string what) {
    if (!what.empty()) faults.push_back({key, std::move(what)});
  };
  add("listen", fault_of_listen(settings));
  add("names", fault_of_names(settings));
  if (settings.token_file.empty()) add("token_file", "must name a file, since [service] listen is set");
  constexpr std::size_t max_socket_path = 107;  // the kernel's
  if (settings.faults.size() > max_socket_path)
    add("faults", fmt::format("must be a path of at most {} bytes", max_socket_path));
  if (settings.has_tls() && settings.tls.key.empty()) add("tls_key", "must be there with tls_certificate");
  if (settings.has_tls()) return faults;
  if (!settings.tls.key.empty()) add("tls_certificate", "must be there with tls_key");
  if (!settings.tls.authority.empty()) add("tls_client_ca", "must not be there without tls_certificate");
  return faults;
}

std::vector<std::string> hosts_of(const ServiceSettings& settings, std::uint16_t port) {
  std::vector<std::string> hosts = settings.names;
  hosts.emplace_back("localhost");
  const std::string listened = web::host_port_from(settings.listen)->host;
  if (!web::is_any_address(listened)) {
    hosts.push_back(listened);
  } else {
    hosts.emplace_back("127.0.0.1");
    if (listened == "::") hosts.emplace_back("::1");
  }
  const std::uint16_t usual = settings.has_tls() ? 443 : 80;  // browsers leave that one out
  std::vector<std::string> places;
  for (const std::string& host : hosts) {
    places.push_back(web::text_of({host, port}));
    if (port == usual) places.push_back(web::url_host(host));
  }
  return places;
}

std::string url_of(const ServiceSettings& settings, std::uint16_t port) {
  const std::string host = settings.names.empty() ? web::host_port_from(settings.listen)->host : settings.names.front();
  return fmt::format("{}://{}", settings.has_tls() ? "https" : "http", web::text_of({host, port}));
}

}  // namespace ledgerline::ground::service
