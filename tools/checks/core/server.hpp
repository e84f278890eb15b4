#pragma once
#include <cstdint>
#include <string>

#include "tools/checks/core/problem.hpp"

/// What is checked of a way to a peer or an orderer: each layer by itself. Pure.
namespace ledgerline::checks {

struct ServerFacts {
  std::string what;            ///< "peer of agent.toml"
  std::string endpoint;        ///< HOST:PORT
  std::string name;            ///< that its certificate must have
  std::string tls_ca;          ///< file
  std::string no_authority{};  ///< why tls_ca was not read
  Problem authority_problem = Problem::tls_ca_unreadable;
  std::string authority_cure{};
  std::string no_pair{};  ///< the files of the own certificate, where they are none
  enum class Reached : std::uint8_t { yes, malformed, name_unknown, no_route, silent, closed };
  Reached reached = Reached::yes;
  std::string why{};  ///< it was not reached, in the system's words
  bool tls = false;   ///< the handshake succeeded, with any server
  bool http2 = false;
  bool mute = false;                  ///< it took the connection and then said nothing in time
  bool wants_certificate = false;     ///< and has not got one
  std::string refuses_certificate{};  ///< the alert that it answered the own certificate with; empty: none
  // Of its certificate.
  bool trusted = false, right_name = false, expired = false, not_yet = false;
  std::string issuer{}, names{};
};
Finding assess(const ServerFacts& facts);

/// Whether it is HOST:PORT; "[::1]:7051" is.
bool is_endpoint(const std::string& text);

}  // namespace ledgerline::checks
