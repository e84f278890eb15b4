#include "tools/identity/core/authority_commands.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace ledgerline::identity {
namespace {

constexpr std::string_view scheme = "https://";

/// What may not stand in a URL's user part as it is.
std::string percent_encoded(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0 || c == '-' || c == '.' || c == '_') {
      out += c;
    } else {
      out += fmt::format("%{:02X}", byte);
    }
  }
  return out;
}

Result<Command> command_of(const Authority& authority, const std::string& home, std::string what,
                           std::vector<std::string> words, const std::string& who = {}) {
  if (!authority.url.starts_with(scheme) || authority.url.size() == scheme.size())
    return Error{fmt::format("\"{}\" is no authority's address: https://HOST:PORT", authority.url)};
  words.insert(words.begin(), authority.program);
  if (!authority.name.empty()) words.insert(words.end(), {"--caname", authority.name});
  return Command{std::move(what),
                 std::move(words),
                 {"FABRIC_CA_CLIENT_HOME=" + home,
                  fmt::format("FABRIC_CA_CLIENT_URL={}{}{}", scheme, who, authority.url.substr(scheme.size())),
                  "FABRIC_CA_CLIENT_TLS_CERTFILES=" + authority.tls_ca}};
}

void add_wanted(std::vector<std::string>& words, const std::string& name, const Wanted& wanted) {
  // Without hosts it would take this machine's name.
  words.insert(words.end(), {"--csr.hosts", wanted.hosts.empty() ? name : wanted.hosts});
  if (!wanted.subject_parts.empty()) words.insert(words.end(), {"--csr.names", wanted.subject_parts});
  if (!wanted.profile.empty()) words.insert(words.end(), {"--enrollment.profile", wanted.profile});
}

}  // namespace

Result<Command> enroll(const Authority& authority, const std::string& home, const std::string& name,
                       const std::string& secret, const Wanted& wanted) {
  std::vector<std::string> words{"enroll"};
  add_wanted(words, name, wanted);
  return command_of(authority, home, "enrolling " + name, std::move(words),
                    percent_encoded(name) + ":" + percent_encoded(secret) + "@");
}

Result<Command> renew(const Authority& authority, const std::string& home, const std::string& name,
                      const Wanted& wanted, bool same_key) {
  std::vector<std::string> words{"reenroll"};
  add_wanted(words, name, wanted);
  if (same_key) words.emplace_back("--csr.keyrequest.reusekey");
  return command_of(authority, home, "renewing " + name, std::move(words));
}

Result<std::vector<Command>> revoke(const Authority& authority, const std::string& home, const Revoked& revoked) {
  const bool one = !revoked.serial.empty() && !revoked.authority_key.empty();
  if (revoked.name.empty() == !one) return Error{"revoked is a name, or a serial number with --aki"};
  std::vector<std::string> words{"revoke"};
  if (one) {
    words.insert(words.end(), {"--revoke.serial", revoked.serial, "--revoke.aki", revoked.authority_key});
  } else {
    words.insert(words.end(), {"--revoke.name", revoked.name});
  }
  auto first = command_of(authority, home, "revoking " + (one ? revoked.serial : revoked.name), std::move(words));
  auto second = command_of(authority, home, "listing what is revoked", {"gencrl"});
  if (!first) return first.error();
  if (!second) return second.error();
  return std::vector{std::move(*first), std::move(*second)};
}

Result<std::string> subject_parts(const std::string& subject) {
  if (subject.find_first_of("\\\"+#") != std::string::npos)
    return Error{
        fmt::format("the subject {} has a part that fabric-ca-client cannot express: give --subject", subject)};
  std::string out;
  for (std::size_t at = 0; at < subject.size();) {
    const std::size_t end = std::min(subject.find(',', at), subject.size());
    const std::string part = subject.substr(at, end - at);
    at = end + 1;
    if (part.starts_with("CN=") || part.starts_with("OU=")) continue;
    out += (out.empty() ? "" : ",") + part;
  }
  return out;
}

}  // namespace ledgerline::identity
