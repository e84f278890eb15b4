#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "common/base/result.hpp"

/// What HTTP's servers and clients share. Words about places are pure; any thread.
namespace ledgerline::web {

/// "127.0.0.1:8800", "ground.example.org:8800", "[fd00::7]:8800".
struct HostPort {
  std::string host;  ///< a name in lower case, or an address as inet_ntop writes it: IPv6 without brackets
  std::uint16_t port = 0;
};
/// The error says what it must be: "must ...".
Result<HostPort> host_port_from(const std::string& text);
std::string text_of(const HostPort& at);
/// As it stands in a URL: IPv6 in brackets.
std::string url_host(const std::string& host);

enum class HostKind { name, ipv4, ipv6 };
/// Of a host as HostPort has it; nullopt: it is none.
std::optional<HostKind> host_kind(const std::string& host);
/// An address of this computer alone. False of names, whatever they may stand for.
bool is_loopback(const std::string& host);
/// "0.0.0.0" and "::", every address of the computer.
bool is_any_address(const std::string& host);

/// PEM files of one side of TLS; an empty name: there is none.
struct TlsFiles {
  std::string certificate{};  ///< our own, with those between it and its authority behind it
  std::string key{};          ///< of that certificate, not locked; nobody but its owner may read it
  std::string authority{};    ///< whose certificates the other side must have
};

}  // namespace ledgerline::web
