#include "ground/service/core/guard.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <cctype>

namespace ledgerline::ground::service {
namespace {

/// In a time that does not depend on where they differ.
bool same_secret(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned differ = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    differ |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  return differ == 0;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  return text;
}

/// What may be a token: of the Authorization header, or of the stream's subprotocols.
std::vector<std::string_view> tokens_of(const Head& head) {
  constexpr std::string_view bearer = "bearer ", in_list = "token.";
  if (!head.websocket) {
    // A scheme's case is nobody's business (RFC 9110, 11.1).
    const auto same = [](char a, char b) { return std::tolower(static_cast<unsigned char>(a)) == b; };
    const std::string_view scheme = head.authorization.substr(0, bearer.size());
    if (!std::equal(scheme.begin(), scheme.end(), bearer.begin(), bearer.end(), same)) return {};
    return {head.authorization.substr(bearer.size())};
  }
  std::vector<std::string_view> tokens;
  constexpr std::size_t max_tokens = 4;
  for (std::string_view rest = head.subprotocols; !rest.empty() && tokens.size() < max_tokens;) {
    const auto comma = std::min(rest.find(','), rest.size());
    const std::string_view one = trimmed(rest.substr(0, comma));
    if (one.substr(0, in_list.size()) == in_list) tokens.push_back(one.substr(in_list.size()));
    rest.remove_prefix(std::min(comma + 1, rest.size()));
  }
  return tokens;
}

}  // namespace

Guard::Guard(std::string token, std::vector<std::string> hosts, bool tls)
    : token_(std::move(token)), hosts_(std::move(hosts)), scheme_(tls ? "https://" : "http://") {}

bool Guard::is_own(std::string_view host) const { return std::ranges::find(hosts_, host) != hosts_.end(); }

ApiAnswer Guard::check_origin(const Head& head) const {
  if (!is_own(head.host)) return refusal(403, fmt::format("Host must be one of {}", fmt::join(hosts_, ", ")));
  const bool from_here = head.origin.empty() || (head.origin.substr(0, scheme_.size()) == scheme_ &&
                                                 head.origin.substr(scheme_.size()) == head.host);
  if (!from_here) return refusal(403, "asked by a page of another site");
  return {.status = 0, .body = {}};
}

Guard::Admission Guard::check(const Head& head, const FindSession& find) const {
  if (ApiAnswer refused = check_origin(head); refused.status != 0) return {refused};
  for (const std::string_view token : tokens_of(head)) {
    if (same_secret(token, token_)) return {{.status = 0, .body = {}}};
    if (token.size() != token_digits) continue;
    const Found found = find(token);
    if (found.session) return {{.status = 0, .body = {}}, found.session};
    if (found.session_ended) return {refusal(401, session_over), {}, true};
  }
  return {refusal(401, "the token is missing, or it is another ground's")};
}

bool Budget::spend(TimeNs now) {
  left_ = std::min(per_s_, left_ + per_s_ * to_seconds(std::max<TimeNs>(0, now - last_ns_)));
  last_ns_ = now;
  if (left_ < 1) return false;
  left_ -= 1;
  return true;
}

namespace {

using web::HostKind;

Status check_listen(const ServiceSettings& settings) {
  const auto at = web::host_port_from(settings.listen);
  if (!at) return at.error();
  if (web::host_kind(at->host) == HostKind::name) return Error{"must begin with an address of this computer, no name"};
  if (!settings.has_tls() && !web::is_loopback(at->host))
    return Error{
        "must be of this computer alone (127.0.0.1:PORT) without TLS: set tls_certificate and tls_key, or take an "
        "SSH tunnel from elsewhere"};
  return done;
}

Status check_names(const ServiceSettings& settings) {
  if (!settings.names.empty() && !settings.has_tls())
    return Error{"must not be there without tls_certificate: the page is of this computer alone then"};
  for (const std::string& name : settings.names) {
    if (!web::host_kind(name) || web::is_any_address(name))
      return Error{fmt::format("must be host names in lower case, or addresses, without a port; \"{}\" is none", name)};
  }
  const auto at = web::host_port_from(settings.listen);
  if (at && web::is_any_address(at->host) && settings.has_tls() && settings.names.empty())
    return Error{
        fmt::format("must say by which names or addresses the page is reached, since listen is {}", settings.listen)};
  return done;
}

}  // namespace

std::vector<SettingError> errors_of(const ServiceSettings& settings) {
  std::vector<SettingError> errors;
  const auto add = [&](const char* key, std::string what) { errors.push_back({key, std::move(what)}); };
  if (const Status listen = check_listen(settings); !listen) add("listen", listen.error().message);
  if (const Status names = check_names(settings); !names) add("names", names.error().message);
  if (settings.token_file.empty()) add("token_file", "must name a file, since [service] listen is set");
  constexpr std::size_t max_socket_path = 107;  // the kernel's
  if (settings.faults.size() > max_socket_path)
    add("faults", fmt::format("must be a path of at most {} bytes", max_socket_path));
  if (settings.has_tls() && settings.tls.key.empty()) add("tls_key", "must be there with tls_certificate");
  if (settings.has_tls()) return errors;
  if (!settings.tls.key.empty()) add("tls_certificate", "must be there with tls_key");
  if (!settings.tls.authority.empty()) add("tls_client_ca", "must not be there without tls_certificate");
  return errors;
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
