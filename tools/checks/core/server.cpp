#include "tools/checks/core/server.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace ledgerline::checks {

namespace {

/// Without a scheme and a path.
std::string bare(std::string endpoint) {
  if (const std::size_t scheme = endpoint.find("://"); scheme != std::string::npos) endpoint.erase(0, scheme + 3);
  return endpoint.substr(0, endpoint.find('/'));
}

std::string cure_of_endpoint(const std::string& endpoint) {
  const std::string host_and_port = bare(endpoint);
  if (is_endpoint(host_and_port)) return fmt::format("set it to \"{}\"", host_and_port);
  return fmt::format("add the port that the ledger prints: \"{}:PORT\"", host_and_port);
}

}  // namespace

bool is_endpoint(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos || colon == 0 || text.find('/') != std::string::npos) return false;
  const std::string port = text.substr(colon + 1);
  return !port.empty() && std::all_of(port.begin(), port.end(), [](char c) { return c >= '0' && c <= '9'; });
}

Finding assess(const ServerFacts& facts) {
  constexpr const char* check = "server";
  using Reached = ServerFacts::Reached;
  const std::string what = fmt::format("{} of {}", facts.endpoint, facts.what);
  switch (facts.reached) {
    case Reached::malformed:
      return found(Problem::endpoint_wrong, check, what, cure_of_endpoint(facts.endpoint));
    case Reached::name_unknown:
      return found(Problem::name_unknown, check, fmt::format("{}: {}", what, facts.why));
    case Reached::no_route:
      return found(Problem::no_route, check, fmt::format("{}: {}", what, facts.why));
    case Reached::silent:
      return found(Problem::unreachable, check, what);
    case Reached::closed:
      return found(Problem::port_closed, check, what);
    case Reached::yes:
      break;
  }
  if (!facts.no_authority.empty())
    return found(facts.authority_problem, check, facts.no_authority, facts.authority_cure);
  if (!facts.no_pair.empty()) return found(Problem::tls_pair_wrong, check, fmt::format("{}: {}", what, facts.no_pair));
  if (!facts.refuses_certificate.empty())
    return found(Problem::tls_pair_refused, check, fmt::format("{}: {}", what, facts.refuses_certificate));
  if (!facts.tls && facts.wants_certificate) return found(Problem::tls_client_certificate, check, what);
  if (!facts.tls && facts.mute) return found(Problem::server_mute, check, what);
  if (!facts.tls) return found(Problem::no_tls, check, what);
  // By the authority first: of an outsider's certificate neither dates nor names mean anything.
  if (!facts.trusted) {
    return found(Problem::tls_wrong_authority, check,
                 fmt::format("{}: it is of \"{}\", which {} does not have", what, facts.issuer, facts.tls_ca));
  }
  if (facts.expired) return found(Problem::tls_expired, check, what);
  if (facts.not_yet) return found(Problem::tls_not_yet, check, what);
  if (!facts.right_name) {
    return found(Problem::tls_wrong_name, check,
                 fmt::format("{}: asked by \"{}\", it has {}", what, facts.name, facts.names));
  }
  if (facts.wants_certificate) return found(Problem::tls_client_certificate, check, what);
  if (!facts.http2) return found(Problem::no_tls, check, what);
  return fine(check, fmt::format("{}, as \"{}\"", what, facts.name));
}

}  // namespace ledgerline::checks
