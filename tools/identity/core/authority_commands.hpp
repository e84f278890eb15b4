#pragma once
#include <string>
#include <vector>

#include "chaincode/network/processes/processes.hpp"
#include "common/base/result.hpp"

/// What fabric-ca-client is run with. Pure: tools/identity/shell runs it.
namespace ledgerline::identity {

using network::Command;

/// An authority, and the program that speaks to it.
struct Authority {
  std::string program;  ///< fabric-ca-client
  std::string url;      ///< "https://HOST:PORT"
  std::string tls_ca;   ///< PEM of the authority of its own TLS certificate
  std::string name{};   ///< where one server has several; empty: its first
};

/// What the certificate is to say beside its name. The authority decides on the role (OU).
struct Wanted {
  std::string subject_parts{};  ///< "O=org1.example.com,C=DE"
  std::string hosts{};          ///< with commas; empty: the name
  std::string profile{};        ///< of the authority: "tls"; empty: its default, of identities
};

/// `home`: a folder of fabric-ca-client, whose msp/ is written. The secret is in the environment, not in the words,
/// which every user of the host sees. An error: the URL is not one of https.
Result<Command> enroll(const Authority& authority, const std::string& home, const std::string& name,
                       const std::string& secret, const Wanted& wanted);
/// As the identity that is in home/msp, which signs the question; `same_key`: for the key that it has.
Result<Command> renew(const Authority& authority, const std::string& home, const std::string& name,
                      const Wanted& wanted, bool same_key);
/// All certificates of a name, or the one with this serial number and key identifier (hexadecimal).
struct Revoked {
  std::string name{}, serial{}, authority_key{};
};
/// As the identity in home/msp, which must be allowed to; the second makes home/msp/crls/crl.pem.
Result<std::vector<Command>> revoke(const Authority& authority, const std::string& home, const Revoked& revoked);

/// Of a subject as RFC 2253 writes it what fabric-ca takes as --csr.names: all but CN and OU, which the authority sets.
/// An error: it has a part that cannot be said there.
Result<std::string> subject_parts(const std::string& subject);

}  // namespace ledgerline::identity
