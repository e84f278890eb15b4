#include "tools/doctor/core/server.hpp"

#include <fmt/format.h>

namespace ledgerline::doctor {

Finding judge(const ServerFacts& facts) {
  constexpr const char* check = "server";
  using Reached = ServerFacts::Reached;
  const std::string what = fmt::format("{} of {}", facts.endpoint, facts.what);
  switch (facts.reached) {
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
  if (!facts.no_authority.empty()) return found(Problem::tls_ca_unreadable, check, facts.no_authority);
  if (!facts.tls && facts.wants_certificate) return found(Problem::tls_client_certificate, check, what);
  if (!facts.tls) return found(Problem::no_tls, check, what);
  // By the authority first: of a stranger's certificate neither dates nor names mean anything.
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

}  // namespace ledgerline::doctor
