#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"

/// The identities of a network of our own, in cryptogen's layout under DIR/crypto: three organisations (Org1MSP ...),
/// each with a CA, a TLS CA, peer0, endorser0, a TLS certificate for its chaincode service, and the users Admin, User1
/// and User2 (NodeOUs); and an organisation of orderers. The embedded node and the real network have the same.
namespace ledgerline::identities {

inline constexpr int organisations = 3;

std::string domain_of(int organisation);  ///< "org1.ledgerline"; 0: the orderers', "ledgerline"
std::string msp_id_of(int organisation);  ///< "Org1MSP"
std::string orderer_name(int number);     ///< "orderer.ledgerline", "orderer2.ledgerline", ...

std::filesystem::path organisation_dir(const std::string& dir, int organisation);
std::filesystem::path peer_dir(const std::string& dir, int organisation);
std::filesystem::path user_dir(const std::string& dir, int organisation, const std::string& user);
std::filesystem::path ordering_dir(const std::string& dir);
std::filesystem::path orderer_dir(const std::string& dir, int number);

/// A certificate of the layout: what a member signs with (in its msp/), or its TLS (in its tls/).
struct CertificateSpec {
  std::filesystem::path folder;  ///< of the member, below its organisation's: "peers/peer0.org1.ledgerline"
  std::string tls_name;          ///< TLS: "server" or "client", the name of its files
  crypto::CertificateRequest request;
};
/// Names or addresses of hosts that TLS certificates are good for beside localhost; empty: none.
struct Hosts {
  std::vector<std::string> organisations, orderers;  ///< by number, from 1 on
};
/// All certificates of an organisation; 0: the orderers'.
std::vector<CertificateSpec> certificate_specs(int organisation, int orderers, const Hosts& hosts);

/// What an organisation's authorities made of its CertificateSpec, in the same order.
struct IssuedCertificates {
  crypto::KeyAndCertificate ca, tls_ca;  ///< no key where the authority keeps it to itself
  std::vector<crypto::KeyAndCertificate> members;
};
/// `wanted` and the answer: one element an organisation, the orderers' first.
using Issue =
    std::function<Result<std::vector<IssuedCertificates>>(const std::vector<std::vector<CertificateSpec>>& wanted)>;

/// With a CA and a TLS CA of an organisation made here and now; their keys stay in the layout, as cryptogen's do.
Result<std::vector<IssuedCertificates>> issue_here(const std::vector<std::vector<CertificateSpec>>& wanted);

/// Makes them when DIR/crypto is missing. Keys are 0600. Made under another name and renamed when complete, so that a
/// crash leaves nothing half-made.
Status make(const std::string& dir, int orderers, const Hosts& hosts = {}, const Issue& issue = issue_here);

}  // namespace ledgerline::identities

namespace ledgerline {

/// A call of the contract.
struct FirstCall {
  const char* function;
  std::string argument;
};

/// What an organisation's administrator calls on a new ledger of our own, embedded or Fabric, of three organisations:
/// Org1's User1 is the host of `drones` (none: tello1 to tello16), which are granted to Org2 without a bound; Org2's
/// User1 is an operator. Each may be called again. `organisation` counts from 1, `user` is its User1.
std::vector<FirstCall> first_calls(int organisation, const crypto::IdentityName& user,
                                   const std::vector<std::string>& drones);
/// How many there are, of all organisations.
inline constexpr std::size_t first_call_count = 3;

}  // namespace ledgerline
