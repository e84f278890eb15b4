#pragma once
#include <string>

/// A chaincode package for Fabric's lifecycle that says where a chaincode service is (type ccaas). Pure.
namespace ledgerline::chaincode_lifecycle {

/// How peers reach the service.
struct ServicePlace {
  std::string address;           ///< HOST:PORT, as peers see it
  std::string root_pem{};        ///< authorities of its TLS certificate; empty: no TLS
  bool client_auth = false;      ///< the service wants the peer's certificate (CHAINCODE_TLS_CLIENT_CA)
  std::string client_pem{};      ///< that certificate, where the peer's builder does not put its own in
  std::string client_key_pem{};  ///< its key: anyone who may fetch the package has it
};
std::string connection_json(const ServicePlace& place);

/// tar.gz of metadata.json and of code.tar.gz with connection.json. The same bytes for the same input, so the package's
/// id stays, wherever it is made.
std::string make_package(const std::string& label, const std::string& connection);
/// Of the definition of the contract in this tree. A network of an older one needs a new definition, because what the
/// contract writes needs other endorsements: the first, of records without a version, named its own policy.
std::string contract_version();
/// "label:hash", as peers name it, and as the service gets it in CHAINCODE_ID.
std::string package_id(const std::string& label, const std::string& package);
/// Fabric's rule: a-z, A-Z and 0-9, inside also _ . + -
bool is_label(const std::string& text);

}  // namespace ledgerline::chaincode_lifecycle
